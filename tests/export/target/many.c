/* COUNT updates with random inputs; writes u, as it stands in memory, to u.bin. */
#include "draw.h"

#include <stdio.h>

int main(void)
{
    uint32_t flags = 0U;
    uint32_t k;
    FILE *file = fopen("u.bin", "wb");

    if (file == NULL) {
        return 2;
    }
    for (k = 0U; k < COUNT; k++) {
        struct inputs next;
        law_real u[LAW_INPUTS];

        draw(&next);
        flags |= law_update(VALUES(next, u));
        if (fwrite(u, sizeof(u), 1U, file) != 1U) {
            return 2;
        }
    }
    if (fclose(file) != 0) {
        return 2;
    }
    return (flags == LAW_OK) ? 0 : 1;
}
