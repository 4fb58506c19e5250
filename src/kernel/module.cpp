// Python's door to the kernel: checks shapes, lays out blocks, releases the GIL, runs.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdlib>
#include <exception>
#include <new>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "kernel.hpp"

namespace nb = nanobind;

void add_exact(nb::module_ &);  // exact.cpp
void add_bound(nb::module_ &);  // bound.cpp
void add_drive(nb::module_ &);  // drive.cpp
void add_laws(nb::module_ &);  // laws.cpp
void add_peaks(nb::module_ &);  // peaks.cpp

namespace polefence {

struct Memory::Allocation {
    double *data;
    Allocation *next;
};

Memory::~Memory() {
    while (allocations) {
        Allocation *next = allocations->next;
        std::free(allocations->data);
        delete allocations;
        allocations = next;
    }
}

double *Memory::take(std::int64_t count) {
    auto *data = static_cast<double *>(
        std::calloc(static_cast<std::size_t>(count > 0 ? count : 1), sizeof(double)));
    if (!data) throw std::bad_alloc();
    allocations = new Allocation{data, allocations};
    return data;
}

void in_threads(std::int64_t threads, void (*work)(void *, std::int64_t), void *of) {
    std::vector<std::thread> others;
    others.reserve(static_cast<std::size_t>(threads - 1));
    std::exception_ptr ended;
    std::int64_t begun = 1;
    try {
        for (; begun < threads; ++begun) others.emplace_back(work, of, begun);
    } catch (const std::system_error &) {  // no more threads: the rest is done here
    }
    try {
        work(of, 0);
        for (; begun < threads; ++begun) work(of, begun);
    } catch (...) {
        ended = std::current_exception();
    }
    for (auto &own : others) own.join();
    if (ended) std::rethrow_exception(ended);
}

}  // namespace polefence

namespace {

constexpr std::int64_t between = 100'000'000;  // multiplications: a tenth of a second at most

class Watch;
thread_local Watch *watch = nullptr;

// Whom the run in this thread tells how many iterations are done, and the work until then.
class Watch {
  public:
    Watch(const polefence::State &own, const nb::object &listener) : state(own), told(listener) {
        watch = this;
    }
    Watch(const Watch &) = delete;
    Watch &operator=(const Watch &) = delete;
    ~Watch() { watch = before; }

    const polefence::State &state;
    const nb::object &told;
    std::int64_t left = between;

  private:
    Watch *before = watch;
};

}  // namespace

namespace polefence {

void worked(std::int64_t multiplications) {
    if (!watch || (watch->left -= multiplications) > 0) return;
    watch->left = between;
    nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (!watch->told.is_none()) watch->told(watch->state.iterations);
}

}  // namespace polefence

namespace {

using polefence::Block;
using polefence::Term;
using Int = std::int64_t;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrices = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Weights = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<const Int, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const Int, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using TermArrays = std::tuple<Matrices, Matrices, Matrices, Rows, Weights>;
using FamilyArrays = std::vector<TermArrays>;

void require(bool fine, const char *message) {
    if (!fine) throw nb::value_error(message);
}

// The row from which R = [0; I; 0] selects, or -1.
Int selection(const double *R, Int size, Int c) {
    Int start = -1;
    for (Int i = 0; i < size && start < 0; ++i)
        if (R[i * c] != 0.0) start = i;
    if (start < 0 || start + c > size) return -1;
    for (Int i = 0; i < size; ++i)
        for (Int j = 0; j < c; ++j)
            if (R[i * c + j] != (i == start + j ? 1.0 : 0.0)) return -1;
    return start;
}

struct Layout {
    std::vector<Block> blocks;
    std::vector<Term> terms;
    std::vector<polefence::Piece> pieces;
    std::vector<Int> bounds;
    std::vector<polefence::Entry> entries;
    Int total = 0, order = 0;

    // Collects the entries of D and M (size x a): first those of D, then those of M alone.
    std::tuple<Int, Int, Int> add_entries(const double *D, const double *M, Int size, Int a) {
        const auto first = static_cast<Int>(entries.size());
        for (Int i = 0; i < size * a; ++i)
            if (D[i] != 0.0) entries.push_back({i / a, i % a, D[i], M[i]});
        const auto middle = static_cast<Int>(entries.size());
        for (Int i = 0; i < size * a; ++i)
            if (D[i] == 0.0 && M[i] != 0.0) entries.push_back({i / a, i % a, 0.0, M[i]});
        return {first, middle, static_cast<Int>(entries.size())};
    }

    // Splits the rows of p matrices (p x a) into pieces.
    Int add_pieces(const Int *rows, Int p, Int a, Int c) {
        const auto first = static_cast<Int>(bounds.size());
        bounds.push_back(static_cast<Int>(pieces.size()));
        for (Int k = 0; k < p; ++k) {
            for (Int i = 0; i < a; ++i) {
                const Int row = rows[k * a + i];
                if (i > 0 && row == rows[k * a + i - 1] + c)
                    pieces.back().until += c;
                else
                    pieces.push_back({i * c, (i + 1) * c, row});
            }
            bounds.push_back(static_cast<Int>(pieces.size()));
        }
        return first;
    }
};

void add_family(const FamilyArrays &family, Int entries, Layout &layout) {
    auto &[blocks, terms, pieces, bounds, all_entries, total, order] = layout;
    require(!family.empty(), "a family has no terms");
    const auto &first = std::get<0>(family[0]);
    const auto count = static_cast<Int>(first.shape(0)), size = static_cast<Int>(first.shape(1));
    require(count > 0 && size > 0, "a family has no blocks");
    for (Int k = 0; k < count; ++k) {
        const auto begin = static_cast<Int>(terms.size());
        for (const auto &[D, M, R, rows, weights] : family) {
            const auto a = static_cast<Int>(D.shape(2)), c = static_cast<Int>(R.shape(2)),
                       p = static_cast<Int>(rows.shape(1));
            require(a > 0 && c > 0 && p > 0, "a term is empty");
            for (const auto *matrix : {&D, &M})
                require(static_cast<Int>(matrix->shape(0)) == count &&
                            static_cast<Int>(matrix->shape(1)) == size &&
                            static_cast<Int>(matrix->shape(2)) == a,
                        "D and M do not fit");
            require(static_cast<Int>(R.shape(0)) == count && static_cast<Int>(R.shape(1)) == size,
                    "R does not fit");
            require(static_cast<Int>(rows.shape(0)) == count && static_cast<Int>(rows.shape(2)) == a &&
                        static_cast<Int>(weights.shape(0)) == count &&
                        static_cast<Int>(weights.shape(1)) == p,
                    "rows and weights do not fit");
            const Int *where = rows.data() + k * p * a;
            for (Int i = 0; i < p * a; ++i)
                require(where[i] >= 0 && where[i] <= entries - c, "a row lies outside the entries");
            const double *right = R.data() + k * size * c;
            const auto [first_entry, middle, last_entry] =
                layout.add_entries(D.data() + k * size * a, M.data() + k * size * a, size, a);
            terms.push_back({a, c, p, first_entry, middle, last_entry, right, where,
                             weights.data() + k * p, selection(right, size, c),
                             layout.add_pieces(where, p, a, c)});
        }
        blocks.push_back({size, begin, static_cast<Int>(terms.size()), total});
        total += size * size;
        order += size;
    }
}

bool has_avx2() {
#ifdef POLEFENCE_AVX2
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
    return false;
#endif
}

// A pencil as the interior point wants it; what Python has of it must outlive it.
class Laid {
  public:
    Laid(Int unknowns, const Integers &entries, const std::vector<FamilyArrays> &families) {
        const auto count = static_cast<Int>(entries.shape(0));
        for (Int i = 0; i < count; ++i)
            require(entries.data()[i] >= 0 && entries.data()[i] < unknowns, "an entry is no unknown");
        for (const auto &family : families) add_family(family, count, layout);
        require(!layout.blocks.empty(), "there are no blocks");
        problem = {unknowns,
                   count,
                   static_cast<Int>(layout.blocks.size()),
                   static_cast<Int>(layout.terms.size()),
                   entries.data(),
                   layout.blocks.data(),
                   layout.terms.data(),
                   layout.entries.data(),
                   layout.pieces.data(),
                   layout.bounds.data(),
                   layout.total,
                   layout.order,
                   static_cast<Int>(layout.entries.size())};
    }
    Laid(const Laid &) = delete;
    Laid &operator=(const Laid &) = delete;

    polefence::Problem problem{};

  private:
    Layout layout;
};

nb::tuple run(Int unknowns, const Integers &entries, const std::vector<FamilyArrays> &families,
              const Vector &x, double r, double tolerance, double enough, Int order,
              Int max_iterations, Int threads, bool plain, bool central, const nb::object &told) {
    require(unknowns > 0 && static_cast<Int>(x.shape(0)) == unknowns, "x does not fit");
    require(order >= 1 && order <= 8, "the order is 1 to 8");
    require(max_iterations >= 0 && max_iterations <= 10000, "the iterations are 0 to 10000");
    require(threads >= 1 && threads <= 256, "there are 1 to 256 threads");
    require(tolerance > 0 && tolerance < 1, "the tolerance is a share");
    const Laid laid(unknowns, entries, families);
    const polefence::Problem &problem = laid.problem;
    const Int total = problem.total;

    auto *out = new double[static_cast<std::size_t>(unknowns)];
    nb::capsule out_owner(out, [](void *data) noexcept { delete[] static_cast<double *>(data); });
    auto *Y = new double[static_cast<std::size_t>(total)];
    nb::capsule Y_owner(Y, [](void *data) noexcept { delete[] static_cast<double *>(data); });
    for (Int i = 0; i < unknowns; ++i) out[i] = x.data()[i];
    auto *trail = new double[static_cast<std::size_t>((max_iterations + 1) * (unknowns + 1))];
    nb::capsule trail_owner(trail, [](void *data) noexcept { delete[] static_cast<double *>(data); });

    const polefence::Options options{tolerance, enough, central, order, max_iterations, threads};
    polefence::State state{out, Y, trail, r, 0.0, 0, false};
    bool started = false;
    {
        const Watch own(state, told);
        nb::gil_scoped_release release;
        polefence::Memory memory;
#ifdef POLEFENCE_AVX2
        started = has_avx2() && !plain ? polefence::run_avx2(problem, options, state, memory)
                                       : polefence::run_plain(problem, options, state, memory);
#else
        (void)plain;
        started = polefence::run_plain(problem, options, state, memory);
#endif
    }
    using Out = nb::ndarray<nb::numpy, double, nb::ndim<1>>;
    const std::size_t x_shape[] = {static_cast<std::size_t>(unknowns)};
    const std::size_t Y_shape[] = {static_cast<std::size_t>(total)};
    const std::size_t trail_shape[] = {static_cast<std::size_t>(started ? state.iterations + 1 : 0),
                                       static_cast<std::size_t>(unknowns + 1)};
    using Rows = nb::ndarray<nb::numpy, double, nb::ndim<2>>;
    return nb::make_tuple(started, Out(out, 1, x_shape, out_owner), state.r,
                          Out(Y, 1, Y_shape, Y_owner), state.gap, state.iterations,
                          state.converged, Rows(trail, 2, trail_shape, trail_owner));
}

// The share of `most` and the r at which x is interior, None where there is none.
nb::object inside(Int unknowns, const Integers &entries, const std::vector<FamilyArrays> &families,
                  const Vector &x, const std::optional<Vector> &most, bool plain) {
    require(unknowns > 0 && static_cast<Int>(x.shape(0)) == unknowns, "x does not fit");
    require(!most || static_cast<Int>(most->shape(0)) == unknowns, "the largest x does not fit");
    const Laid laid(unknowns, entries, families);
    const polefence::State state{};
    const nb::object told = nb::none();
    double share = 0, r = 0;
    bool found = false;
    {
        const Watch own(state, told);
        const double *more = most ? most->data() : nullptr;
        nb::gil_scoped_release release;
        polefence::Memory memory;
#ifdef POLEFENCE_AVX2
        if (has_avx2() && !plain)
            found = polefence::inside_avx2(laid.problem, x.data(), more, share, r, memory);
        else
#endif
            found = polefence::inside_plain(laid.problem, x.data(), more, share, r, memory);
        (void)plain;
    }
    return found ? nb::object(nb::make_tuple(share, r)) : nb::none();
}

nb::tuple minimum(const Matrix &P, const Vector &q, const Matrix &G, const Vector &h, double reach,
                  Int bounded, bool plain) {
    const auto n = static_cast<Int>(q.shape(0)), m = static_cast<Int>(h.shape(0));
    require(n > 0 && static_cast<Int>(P.shape(0)) == n && static_cast<Int>(P.shape(1)) == n,
            "P does not fit");
    require(static_cast<Int>(G.shape(0)) == m && static_cast<Int>(G.shape(1)) == n,
            "G does not fit");
    require(bounded >= 0 && bounded <= n && m + bounded > 0, "so many entries have no bounds");
    auto *x = new double[static_cast<std::size_t>(n)];
    nb::capsule x_owner(x, [](void *data) noexcept { delete[] static_cast<double *>(data); });
    auto *z = new double[static_cast<std::size_t>(m)];
    nb::capsule z_owner(z, [](void *data) noexcept { delete[] static_cast<double *>(data); });
    const polefence::Program program{n, m, bounded, P.data(), q.data(), G.data(), h.data(), reach};
    {
        nb::gil_scoped_release release;
        polefence::Memory memory;
#ifdef POLEFENCE_AVX2
        if (has_avx2() && !plain)
            polefence::minimum_avx2(program, x, z, memory);
        else
#endif
            polefence::minimum_plain(program, x, z, memory);
        (void)plain;
    }
    using Out = nb::ndarray<nb::numpy, double, nb::ndim<1>>;
    const std::size_t x_shape[] = {static_cast<std::size_t>(n)};
    const std::size_t z_shape[] = {static_cast<std::size_t>(m)};
    return nb::make_tuple(Out(x, 1, x_shape, x_owner), Out(z, 1, z_shape, z_owner));
}

}  // namespace

NB_MODULE(_kernel, module) {
    module.doc() =
        "The interior points of polefence.lmi.solve, the descents of polefence.search.tune, a prover, "
        "and drives, compiled.";
    module.def("instructions", [] { return std::string(has_avx2() ? "AVX2" : "baseline"); });
    module.def("run", &run, nb::arg("unknowns"), nb::arg("entries").noconvert(), nb::arg("families"),
               nb::arg("x").noconvert(), nb::arg("r"), nb::arg("tolerance"), nb::arg("enough"),
               nb::arg("order"), nb::arg("max_iterations"), nb::arg("threads") = 1,
               nb::arg("plain") = false, nb::arg("central") = false,
               nb::arg("told") = nb::none());
    module.def("inside", &inside, nb::arg("unknowns"), nb::arg("entries").noconvert(),
               nb::arg("families"), nb::arg("x").noconvert(), nb::arg("most").noconvert().none(),
               nb::arg("plain") = false);
    module.def("minimum", &minimum, nb::arg("P").noconvert(), nb::arg("q").noconvert(),
               nb::arg("G").noconvert(), nb::arg("h").noconvert(), nb::arg("reach"),
               nb::arg("bounded"), nb::arg("plain") = false);
    add_exact(module);
    add_bound(module);
    add_drive(module);
    add_laws(module);
    add_peaks(module);
}
