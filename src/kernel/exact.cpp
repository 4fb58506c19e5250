// A second prover of claims about poles, in whole numbers: the inequalities of
// polefence/proof/claims/poles.py from the same rationals, decided exactly, or not at all.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#ifdef __SIZEOF_INT128__
#include "numbers.hpp"

namespace nb = nanobind;

namespace {

using namespace polefence;
using PairArrays = std::vector<std::tuple<Doubles, Doubles>>;       // L and M, one matrix each

// --- polynomials ----------------------------------------------------------------------------------

template <int K>
using Terms = std::map<std::string, Matrix<K>>;

template <int K>
Terms<K> terms_of(const Form &form) {
    Terms<K> terms;
    std::size_t at = 0;
    for (std::size_t k = 0; k < form.count(); ++k) {
        Matrix<K> matrix(form.rows, form.columns);
        const Whole<K> multinomial(form.multinomials[k]);
        for (auto &entry : matrix.entries)
            entry = multinomial * form.group.numbers[at++].over<K>(form.group.least);
        terms.emplace(form.powers[k], std::move(matrix));
    }
    return terms;
}

template <int K>
Terms<K> terms_of(const Plant &plant) {
    Terms<K> terms;
    std::size_t k = 0;
    for (const auto &e : plant.powers) {
        Matrix<K> matrix(plant.n, plant.columns);
        for (auto &entry : matrix.entries) entry = plant.number<K>(plant.data, k++);
        terms.emplace(e, std::move(matrix));
    }
    return terms;
}

std::string sum(const std::string &one, const std::string &other) {
    std::string both = one;
    for (std::size_t i = 0; i < both.size(); ++i) both[i] = static_cast<char>(both[i] + other[i]);
    return both;
}

template <int K>
Matrix<K> &at(Terms<K> &terms, const std::string &e, std::size_t rows, std::size_t columns) {
    return terms.try_emplace(e, rows, columns).first->second;
}

template <int K>
Terms<K> product(const Terms<K> &P, const Terms<K> &Q) {
    Terms<K> result;
    for (const auto &[d, p] : P)
        for (const auto &[e, q] : Q) at(result, sum(d, e), p.rows, q.columns).add(p, q);
    return result;
}

// Multiplies by the sum of each simplex's coordinates.
template <int K>
Terms<K> raised(const Terms<K> &P, const std::vector<Int> &sizes) {
    Terms<K> terms = P;
    std::size_t start = 0;
    for (const Int size : sizes) {
        Terms<K> result;
        for (const auto &[e, matrix] : terms)
            for (Int j = 0; j < size; ++j) {
                std::string higher = e;
                ++higher[start + static_cast<std::size_t>(j)];
                at(result, higher, matrix.rows, matrix.columns) += matrix;
            }
        terms = std::move(result);
        start += static_cast<std::size_t>(size);
    }
    return terms;
}

// Whether there are so many coefficients, and all are positive definite: one that is missing is zero.
template <int K>
Sign all_positive(const Terms<K> &terms, Int count) {
    Sign worst = static_cast<Int>(terms.size()) == count ? Sign::positive : Sign::not_positive;
    for (const auto &[e, matrix] : terms) {
        const Sign own = positive_definite(matrix);
        if (own == Sign::not_positive) return own;
        if (own == Sign::unknown) worst = own;
    }
    return worst;
}

// --- the claims -----------------------------------------------------------------------------------

// X = form V, or form alone, and F = -(L (x) X + M (x) N + M' (x) N') for N = [A, B] form V.
struct Poles {
    std::vector<Int> sizes;
    Plant plant;
    Form form;
    std::optional<Form> V;
    std::vector<std::size_t> orders;
    std::vector<Double> L, M;  // entries, of one power of two
    Int unit = 0;              // that
    Double tau;
    Int elevation, count, positive;

    Int power() const { return unit + form.group.least + (V ? V->group.least : 0); }
    Int square() const {
        const Int rest = std::max<Int>(sizes[0] - 1, 1);
        return rest * rest;
    }

    // How long any number becomes, at most.
    Int bits() const {
        Int own = form.bits(), inner = static_cast<Int>(form.count()), pair = 0, raise = 0;
        if (V) {
            own += V->bits() + length_of(static_cast<Int>(plant.n) * std::min<Int>(inner, V->count()));
            inner *= static_cast<Int>(V->count());
        }
        for (const Double &value : L) pair = std::max(pair, value.bits(unit));
        for (const Double &value : M) pair = std::max(pair, value.bits(unit));
        for (const Int size : sizes) raise += length_of(size);
        const Int vertices = static_cast<Int>(plant.powers.size());
        own += plant.bits() + raise + length_of(static_cast<Int>(plant.columns) * vertices) + pair + 3;
        if (tau.mantissa) {
            own += length_of(square()) + raise;
            own = 1 + std::max(own, tau.bits(power()) + plant.bits() + 3 + length_of(square()));
        }
        return own + elevation * raise + 2;
    }

    template <int K>
    Sign decide() const {
        for (const auto *each : {&form, V ? &*V : nullptr})
            if (each && !symmetric(*each)) return Sign::not_positive;
        Terms<K> both = terms_of<K>(form);
        if (V) both = product(both, terms_of<K>(*V));
        const Terms<K> N = product(terms_of<K>(plant), both);
        Terms<K> X;
        const Whole<K> denominator = plant.number<K>(plant.denominator, 0);
        for (const auto &[e, matrix] : both) {
            Matrix<K> top(plant.n, plant.n);
            std::copy_n(matrix.entries.begin(), top.entries.size(), top.entries.begin());
            top.scale(denominator);
            X.emplace(e, std::move(top));
        }
        X = raised(X, sizes);
        Sign worst = Sign::positive;
        const auto note = [&worst](Sign own) {
            if (own != Sign::positive && worst != Sign::not_positive) worst = own;
            return worst == Sign::not_positive;
        };
        if (positive && note(elevated_positive(X))) return worst;
        std::size_t start = 0;
        for (const std::size_t order : orders) {
            if (note(elevated_positive(part<K>(X, N, order, start)))) return worst;
            start += order * order;
        }
        return worst;
    }

  private:
    // Whether what is a Lyapunov matrix, all of V or the first rows of a law's, is symmetric.
    bool symmetric(const Form &own) const {
        if (V && &own == &form) return true;
        const std::size_t size = own.rows * own.columns, n = plant.n;
        for (std::size_t k = 0; k < own.count(); ++k)
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t j = 0; j < i; ++j) {
                    const Double &one = own.group.numbers[k * size + i * n + j];
                    const Double &other = own.group.numbers[k * size + j * n + i];
                    if (one.mantissa != other.mantissa || one.exponent != other.exponent) return false;
                }
        return true;
    }

    template <int K>
    Sign elevated_positive(Terms<K> F) const {
        for (Int k = 0; k < elevation - (tau.mantissa ? 1 : 0); ++k) F = raised(F, sizes);
        return all_positive(F, count);
    }

    template <int K>
    Terms<K> part(const Terms<K> &X, const Terms<K> &N, std::size_t order, std::size_t start) const {
        const std::size_t n = plant.n, size = order * n;
        Terms<K> F;
        for (const auto *each : {&X, &N})
            for (const auto &[e, matrix] : *each) at(F, e, size, size);
        for (std::size_t a = 0; a < order; ++a)
            for (std::size_t b = 0; b < order; ++b) {
                const Whole<K> l = -L[start + a * order + b].template over<K>(unit);
                const Whole<K> m = -M[start + a * order + b].template over<K>(unit);
                const Whole<K> t = -M[start + b * order + a].template over<K>(unit);
                for (const auto &[e, x] : X) add(F.at(e), a * n, b * n, l, x, false);
                for (const auto &[e, x] : N) {
                    add(F.at(e), a * n, b * n, m, x, false);
                    add(F.at(e), a * n, b * n, t, x, true);
                }
            }
        return tau.mantissa ? above_floor(raised(F, sizes)) : F;
    }

    template <int K>
    static void add(Matrix<K> &F, std::size_t i, std::size_t j, const Whole<K> &factor,
                    const Matrix<K> &X, bool transposed) {
        if (factor.zero()) return;
        for (std::size_t p = 0; p < X.rows; ++p)
            for (std::size_t q = 0; q < X.columns; ++q)
                F[i + p][j + q].add(factor, transposed ? X[q][p] : X[p][q]);
    }

    // Less the right-hand sides of Theorem 1, all times (N - 1)^2.
    template <int K>
    Terms<K> above_floor(Terms<K> F) const {
        const Whole<K> all(square()), unit_tau = plant.number<K>(plant.denominator, 0) *
                                                 tau.over<K>(power());
        for (auto &[e, matrix] : F) {
            matrix.scale(all);
            const int highest = *std::max_element(e.begin(), e.end());
            const Whole<K> own = unit_tau * (highest == 3 ? all : Whole<K>(highest == 2 ? -1 : -6));
            for (std::size_t i = 0; i < plant.n; ++i) matrix[i][i] -= own;
        }
        return F;
    }
};

std::size_t coordinates_of(const std::vector<Int> &sizes) {
    require(!sizes.empty() && sizes.size() <= 16, "there are 1 to 16 simplices");
    std::size_t total = 0;
    for (const Int size : sizes) {
        require(size > 0 && size <= 256, "a simplex has 1 to 256 corners");
        total += static_cast<std::size_t>(size);
    }
    return total;
}

int poles(const std::vector<Int> &sizes, const PlantArrays &plant_given, const FormArrays &form_given,
          const std::optional<FormArrays> &V_given, const PairArrays &pairs, double tau, Int elevation,
          Int count, bool positive) {
    const std::size_t coordinates = coordinates_of(sizes);
    Plant plant(plant_given, coordinates);
    Form form(form_given, coordinates);
    std::optional<Form> V;
    if (V_given) V.emplace(*V_given, coordinates);
    const std::size_t n = plant.n;
    require(form.rows == plant.columns && form.columns == n, "the law does not fit");
    require(!V || (V->rows == n && V->columns == n), "the Lyapunov matrices do not fit");
    require(elevation >= 0 && elevation <= 16 && count > 0, "the elevation is 0 to 16");
    require(std::isfinite(tau), "a number is not finite");
    require(tau == 0.0 || (sizes.size() == 1 && elevation == 1), "tau is of Theorem 1");
    require(!pairs.empty() && pairs.size() <= 64, "a region has 1 to 64 inequalities");
    std::vector<std::size_t> orders;
    Group L, M;
    for (const auto &[l, m] : pairs) {
        const std::size_t order = l.shape(1);
        require(l.shape(0) == 1 && m.shape(0) == 1 && order > 0 && order <= 4 && l.shape(2) == order &&
                    m.shape(1) == order && m.shape(2) == order,
                "L and M do not fit");
        orders.push_back(order);
        L.take(l.data(), order * order);
        M.take(m.data(), order * order);
    }
    Group both;
    for (const Group *each : {&L, &M})
        if (each->any) both.include(each->least);
    Poles claim{sizes,  std::move(plant),     std::move(form), std::move(V), orders,
                std::move(L.numbers), std::move(M.numbers), both.least, Double(tau), elevation, count,
                positive};
    // tau is a multiple of the others' power of two
    if (claim.tau.mantissa && claim.tau.exponent < claim.power())
        claim.form.group.include(claim.form.group.least - (claim.power() - claim.tau.exponent));
    return tau < 0 ? 0 : in_words(claim, -1);
}

// The inequalities with slack for a disk: [r P, c G - N; ., r (G + G' - P)], N = [A, B] [G; K G].
struct Slack {
    std::vector<Int> sizes;
    Plant plant;
    Form law, P, G;  // [I; K] and one G
    Double centre, radius;
    Int unit, to_P, to_N, count;  // how often P and N are raised in each simplex

    Int bits() const {
        const Int lyapunov = std::max(P.group.any ? most(P) : 0, most(G)) + multinomial();
        const Int factor = std::max({centre.bits(unit), radius.bits(unit), Double(1.0).bits(unit)});
        Int raise = 0;
        for (const Int size : sizes) raise += length_of(size);
        const Int wide = static_cast<Int>(plant.columns * plant.n * plant.powers.size());
        // N: plant, law, G; the others: plant's denominator, one of the law, G
        return plant.bits() + law.bits() + lyapunov + factor + length_of(wide) + 4 +
               raise * (to_P + to_N + 1);
    }

    template <int K>
    Sign decide() const {
        const std::size_t n = plant.n;
        Terms<K> p = terms_of<K>(P), g = terms_of<K>(G);
        for (const auto &[e, matrix] : p)
            if (!matrix.symmetric()) return Sign::not_positive;
        Terms<K> N = product(terms_of<K>(plant), product(terms_of<K>(law), g));
        const Whole<K> one = Whole<K>(1) << -law.group.least;
        const Whole<K> common = one * plant.number<K>(plant.denominator, 0);
        for (auto *each : {&p, &g})
            for (auto &[e, matrix] : *each) matrix.scale(common);
        for (Int k = 0; k < to_P; ++k) p = raised(p, sizes);
        for (Int k = 0; k < to_N; ++k) N = raised(N, sizes);
        for (Int k = 0; k < to_N + 1; ++k) g = raised(g, sizes);
        const Whole<K> r = radius.over<K>(unit), c = centre.over<K>(unit);
        const Whole<K> minus = -(Whole<K>(1) << -unit);
        if (static_cast<Int>(g.size()) != count) return Sign::not_positive;
        Terms<K> F;
        for (const auto &[e, own] : g) {
            Matrix<K> &f = at(F, e, 2 * n, 2 * n);
            const Matrix<K> none(n, n), &x = p.count(e) ? p.at(e) : none, &y = N.count(e) ? N.at(e) : none;
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t j = 0; j < n; ++j) {
                    Whole<K> right = own[i][j];
                    right += own[j][i];
                    right -= x[i][j];
                    f[i][j].add(r, x[i][j]);
                    f[n + i][n + j].add(r, right);
                    f[i][n + j].add(c, own[i][j]);
                    f[i][n + j].add(minus, y[i][j]);
                    f[n + j][i] = f[i][n + j];
                }
        }
        return all_positive(F, count);
    }

  private:
    static Int most(const Form &form) { return form.group.bits(); }
    Int multinomial() const { return P.bits() - P.group.bits(); }
};

int slack(const std::vector<Int> &sizes, const PlantArrays &plant_given, const FormArrays &law_given,
          const FormArrays &P_given, const FormArrays &G_given, double centre, double radius, Int to_P,
          Int to_N, Int count) {
    const std::size_t coordinates = coordinates_of(sizes);
    Slack claim{sizes,
                Plant(plant_given, coordinates),
                Form(law_given, coordinates),
                Form(P_given, coordinates),
                Form(G_given, coordinates),
                Double(centre),
                Double(radius),
                0,
                to_P,
                to_N,
                count};
    const std::size_t n = claim.plant.n;
    require(std::isfinite(centre) && std::isfinite(radius), "a number is not finite");
    require(claim.law.count() == 1 && claim.law.rows == claim.plant.columns && claim.law.columns == n,
            "the law does not fit");
    require(claim.P.rows == n && claim.P.columns == n && claim.G.count() == 1 && claim.G.rows == n &&
                claim.G.columns == n,
            "P and G do not fit");
    require(to_P >= 0 && to_P <= 32 && to_N >= 0 && to_N <= 32 && count > 0, "degrees are 0 to 32");
    Group region;
    const double numbers[] = {centre, radius, 1.0};
    region.take(numbers, 3);
    claim.unit = region.least;
    // P and G have one power of two, as [I; K] has, which the 1 in it keeps at one or below
    claim.law.group.include(0);
    Group both;
    for (const Form *each : {&claim.P, &claim.G})
        if (each->group.any) both.include(each->group.least);
    claim.P.group.least = claim.G.group.least = both.least;
    return in_words(claim, -1);
}

}  // namespace

void add_exact(nb::module_ &module) {
    module.def("poles", &poles, nb::arg("sizes"), nb::arg("plant"), nb::arg("form"),
               nb::arg("V").none(), nb::arg("pairs"), nb::arg("tau"), nb::arg("elevation"),
               nb::arg("count"), nb::arg("positive"));
    module.def("slack", &slack, nb::arg("sizes"), nb::arg("plant"), nb::arg("law"), nb::arg("P"),
               nb::arg("G"), nb::arg("centre"), nb::arg("radius"), nb::arg("to_P"), nb::arg("to_N"),
               nb::arg("count"));
}

#else

void add_exact(nanobind::module_ &) {}  // no whole numbers of 128 bits: Python proves

#endif
