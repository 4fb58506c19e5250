/* COUNT updates of a law with states of its own, with random inputs; writes u and the states, as
 * they stand in memory, to u.bin. */
#include "draw.h"

#include <stdio.h>

int main(void)
{
    uint32_t flags = 0U;
    uint32_t k;
    law_memory memory;
    FILE *file = fopen("u.bin", "wb");

    if (file == NULL) {
        return 2;
    }
    law_reset(&memory);
    for (k = 0U; k < COUNT; k++) {
        struct inputs next;
        law_real u[LAW_INPUTS];

        draw(&next);
        flags |= law_update(&memory, VALUES(next, u));
        if ((fwrite(u, sizeof(u), 1U, file) != 1U) ||
            (fwrite(&memory, sizeof(memory), 1U, file) != 1U)) {
            return 2;
        }
    }
    if (fclose(file) != 0) {
        return 2;
    }
    return ((flags & LAW_NO_CONTROL) == 0U) ? 0 : 1;
}
