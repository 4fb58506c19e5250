// The interior points of src/polefence/lmi/solve/interior_point.py and of
// src/polefence/search/tune/quadratic.py on plain arrays: data, memory, entry points.
#pragma once
#include <cstddef>
#include <cstdint>

namespace polefence {

// An entry of L = r D - M that is not always zero.
struct Entry {
    std::int64_t row, column;
    double D, M;
};

// One term L X R' of one block, L = r D - M; X sums `weights[k]` times the matrix of unknowns whose
// rows start at rows[k a], ..., rows[k a + a - 1] in the list of all variables' entries.
struct Term {
    std::int64_t a, c, p;        // X is a x c, a sum of p
    std::int64_t first, middle, last;  // entries of L; those with D != 0 come before `middle`
    const double *R;             // size x c
    const std::int64_t *rows;    // p x a
    const double *weights;       // p
    std::int64_t selected;       // R selects the rows from here on; -1: R is any matrix
    std::int64_t pieces;         // of matrix k: piece[bound[pieces + k]] to piece[bound[pieces + k + 1]]
};

// Entries of X, row by row, that follow each other in the list of all entries too.
struct Piece {
    std::int64_t from, until, to;
};

struct Block {
    std::int64_t size, first, last;  // its terms
    std::int64_t offset;             // of its matrix in arrays over all blocks
};

struct Problem {
    std::int64_t unknowns, entries, blocks, terms;
    const std::int64_t *entry;   // which unknown each entry is
    const Block *block;
    const Term *term;
    const Entry *left;           // of all terms
    const Piece *piece;
    const std::int64_t *bound;
    std::int64_t total, order, lefts;  // sums of size^2 and of size; number of entries `left`
};

struct Options {
    double tolerance, enough;
    bool central;  // whether to go to the analytic centre at r = enough
    std::int64_t order, max_iterations, threads;
};

// In: x, r. Out: x, r, Y (total), r and x of every iterate (max_iterations + 1 rows), how it went.
struct State {
    double *x, *Y, *trail;
    double r, gap;
    std::int64_t iterations;
    bool converged;
};

// Minimise x' P x / 2 + q' x with G x <= h, the first entries of x within -reach and reach.
struct Program {
    std::int64_t n, m, bounded;  // of x, rows of G, entries within reach
    const double *P, *q, *G, *h;
    double reach;
};

// Counts multiplications: after every so many, Python may end what this thread does, by an error.
void worked(std::int64_t multiplications);

// Calls work(of, 0), ..., work(of, threads - 1), each in a thread of its own, the first in this one,
// which alone may be ended by `worked`.
void in_threads(std::int64_t threads, void (*work)(void *, std::int64_t), void *of);

// Owns every array of a run; each is an allocation of its own, so that overruns show.
class Memory {
  public:
    Memory() = default;
    Memory(const Memory &) = delete;
    Memory &operator=(const Memory &) = delete;
    ~Memory();
    double *take(std::int64_t count);  // zeros

  private:
    struct Allocation;
    Allocation *allocations = nullptr;
};

bool run_plain(const Problem &, const Options &, State &, Memory &);
void minimum_plain(const Program &, double *x, double *multipliers, Memory &);
bool inside_plain(const Problem &, const double *x, const double *most, double &share, double &r,
                  Memory &);
#ifdef POLEFENCE_AVX2
bool run_avx2(const Problem &, const Options &, State &, Memory &);
void minimum_avx2(const Program &, double *x, double *multipliers, Memory &);
bool inside_avx2(const Problem &, const double *x, const double *most, double &share, double &r,
                 Memory &);
#endif

}  // namespace polefence
