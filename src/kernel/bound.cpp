// A second prover of lower bounds, in whole numbers: that dual matrices near the ones given satisfy
// the equations of polefence/proof/lower.py exactly. docs/theory.md has the reasons.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#ifdef __SIZEOF_INT128__
#include "numbers.hpp"

namespace nb = nanobind;

namespace {

using namespace polefence;
using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

constexpr double UP = 1.01;  // more than the rounding of sums of a few thousand products comes to
// Sizes of changes are taken for no smaller, so that what their products lose below 1e-308 is less.
constexpr double LEAST = 1e-290, LEAST_SIZE = 1e-140, LEAST_MARGIN = 1e-150;
constexpr double SMALL = 1e-60, LARGE = 1e60;  // of scales and radii
constexpr int NONE = -1, UNKNOWN = -2;

// A number no less than |value| 2^exponent, and one no more.
template <int K>
double above(const Whole<K> &value, Int exponent) {
    const Int length = value.bits();
    if (!length) return 0.0;
    const Whole<K> size = value.negative() ? -value : value;
    const Int shift = std::max<Int>(length - 50, 0);
    const double top = static_cast<double>((size >> shift).w[0]) + 1.0;
    return std::max(std::ldexp(top, static_cast<int>(shift + exponent)), LEAST);
}
template <int K>
double below(const Whole<K> &value, Int exponent) {
    const Int shift = std::max<Int>(value.bits() - 50, 0);
    return std::ldexp(static_cast<double>((value >> shift).w[0]), static_cast<int>(shift + exponent));
}

struct Pairing {
    std::size_t block, j, k;
};

struct Bound {
    bool slack, right_hand_sides, joint;
    std::size_t N, n, m, p, blocks, kinds;  // p: columns of Psi; kinds: of unknowns Z_k
    std::vector<Pairing> pairs;
    Plant plant;
    Double sigma;
    Group Y, Psi;
    std::vector<double> psi, scale, rho;  // |Psi|; of states, powers of two; of the rows of Theta
    std::vector<Int> power;               // of `scale`
    std::vector<Double> radii;

    Int lift() const { return sigma.mantissa ? std::max<Int>(-sigma.exponent, 0) : 0; }

    Int bits() const {
        Int longest = 0, finest = 0;
        for (const Double &r : radii) {
            longest = std::max(longest, r.length() + std::abs(r.exponent));
            finest = std::max(finest, -r.exponent);
        }
        const Int count = length_of(static_cast<Int>(n * (pairs.size() + N)));
        const Int own = plant.bits() + lift() + sigma.length() + std::max<Int>(sigma.exponent, 0) + 1;
        const Int V = own + Y.bits() + count + 1;
        const Int block = own + longest + Y.bits() + length_of(static_cast<Int>(2 * N + 2)) + 4;
        const Int G = own + Psi.bits() + count + std::max<Int>(-Psi.least, 0) + 1;
        const Int trace = length_of(static_cast<Int>(6 * blocks * n * N * N));
        return std::max({V + finest + 2, block, G}) + trace + count + 4;
    }

    // The index of the first radius that is proved.
    template <int K>
    int decide() const;
};

template <int K>
class Search {
  public:
    explicit Search(const Bound &given) : own(given), n(given.n) {}

    int first() {
        read();
        if (!fits()) return NONE;
        for (std::size_t b = 0; b < own.blocks; ++b) {
            if (zero[b] || anchor(b)) continue;
            const Sign sign = positive_definite(Y[b]);
            if (sign != Sign::positive) return sign == Sign::unknown ? UNKNOWN : NONE;
        }
        for (std::size_t i = 0; i < own.radii.size(); ++i) {
            const Sign sign = at(own.radii[i]);
            if (sign == Sign::positive) return static_cast<int>(i);
            if (sign == Sign::unknown) return UNKNOWN;
        }
        return NONE;
    }

  private:
    const Bound &own;
    const std::size_t n;
    Whole<K> denominator;
    std::vector<Matrix<K>> S, B, Y, V, E, sums;
    std::vector<bool> zero;
    std::vector<double> size_S, delta, eta;  // |S|; margins of blocks; of kinds

    bool anchor(std::size_t b) const { return b < own.N; }
    std::size_t kind(std::size_t b) const { return own.joint ? 0 : b; }

    void read() {
        const Int lift = own.lift();
        denominator = own.plant.number<K>(own.plant.denominator, 0) << lift;
        const Whole<K> shift = own.plant.number<K>(own.plant.denominator, 0) *
                               own.sigma.over<K>(own.sigma.mantissa ? -lift : 0);
        std::size_t at = 0;
        for (std::size_t j = 0; j < own.N; ++j) {
            S.emplace_back(n, n);
            B.emplace_back(n, own.m);
            for (std::size_t i = 0; i < n; ++i) {
                for (std::size_t c = 0; c < n + own.m; ++c) {
                    const Whole<K> value = own.plant.number<K>(own.plant.data, at++) << lift;
                    (c < n ? S[j][i][c] : B[j][i][c - n]) = value;
                }
                S[j][i][i] += shift;
            }
        }
        at = 0;
        for (std::size_t b = 0; b < own.blocks; ++b) {
            Y.emplace_back(2 * n, 2 * n);
            bool none = true;
            for (auto &entry : Y[b].entries) {
                entry = own.Y.numbers[at++].over<K>(own.Y.least);
                none = none && entry.zero();
            }
            zero.push_back(none);
        }
        for (std::size_t k = 0; k < own.kinds; ++k) {
            V.emplace_back(n, n);
            E.emplace_back(own.m, n);
            sums.emplace_back(n, n);
        }
        // X_b that are multiplied by the same S_j, added up first
        std::vector<Matrix<K>> X(own.N * own.kinds, Matrix<K>(n, n));
        for (const Pairing &pair : own.pairs) {
            const Matrix<K> &y = Y[pair.block];
            if (zero[pair.block]) continue;
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t c = 0; c < n; ++c) {
                    X[pair.j * own.kinds + pair.k][i][c] += y[i][n + c];
                    sums[pair.k][i][c] += y[i][c];
                    sums[pair.k][i][c] += y[n + i][n + c];
                }
        }
        for (std::size_t j = 0; j < own.N; ++j)
            for (std::size_t k = 0; k < own.kinds; ++k) {
                V[k].add_transposed(S[j], X[j * own.kinds + k]);
                E[k].add_transposed(B[j], X[j * own.kinds + k]);
            }
        const double unit = 1.0 / below(denominator, 0);
        for (std::size_t j = 0; j < own.N; ++j)
            for (const auto &entry : S[j].entries) size_S.push_back(UP * unit * above(entry, 0));
    }

    // Whether the matrices are symmetric, P = R where they must be, and Psi a right inverse nearly,
    // so that exact solutions are near; how near, goes into `delta` and `eta`.
    bool fits() {
        if (denominator.bits() > 900) return false;  // beyond doubles
        delta.assign(own.N, 0.0);
        eta.assign(own.kinds, 0.0);
        bool any = false;
        for (std::size_t b = 0; b < own.blocks; ++b) {
            any = any || !zero[b];
            if (own.joint && zero[b]) return false;  // all of them are anchors
            if (!Y[b].symmetric()) return false;
            for (std::size_t i = 0; own.slack && i < n; ++i)
                for (std::size_t c = 0; c < n; ++c)
                    if (!(Y[b][i][c] == Y[b][n + i][n + c])) return false;
        }
        for (std::size_t g = 0; g < own.kinds; ++g) {
            if (!own.joint && zero[g]) {  // nothing may have been left of it elsewhere
                for (const auto *each : {&V[g], &E[g], &sums[g]})
                    for (const auto &entry : each->entries)
                        if (!entry.zero()) return false;
            } else if (!near(g)) {
                return false;
            }
        }
        return any;
    }

    bool near(std::size_t g) {
        const std::size_t first = own.joint ? 0 : g, last = own.joint ? own.N : g + 1, p = own.p;
        const double unit = 1.0 / below(denominator, 0);
        Matrix<K> G(p, p);
        const Whole<K> one = denominator << -own.Psi.least;
        for (std::size_t q = 0; q < p; ++q) G[q][q] -= one;
        for (std::size_t j = first; j < last; ++j)
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t q = 0; q < p; ++q)
                    for (std::size_t c = 0; c < p; ++c)
                        G[q][c].add(form(j, i, q), own.Psi.numbers[(j * n + i) * p + c].template over<K>(own.Psi.least));
        const double *rho = own.rho.data() + g * p;
        for (std::size_t q = 0; q < p; ++q) {
            double total = 0.0;
            for (std::size_t c = 0; c < p; ++c)
                total += above(G[q][c], own.Psi.least) * unit * rho[c] / rho[q];
            if (!(UP * total <= 0.5)) return false;
        }
        // Theta = -(I + G)^-1 [skew part; E], so |Theta| <= 2 rho max |.| / rho, column by column
        std::vector<double> theta(n, LEAST_SIZE);
        for (std::size_t c = 0; c < n; ++c)
            for (std::size_t q = 0; q < p; ++q)
                theta[c] = std::max(theta[c], 2 * UP * unit * above(wanted(g, q, c), own.Y.least) / rho[q]);
        std::vector<double> moved(n * n);
        for (std::size_t j = first; j < last; ++j) {
            std::vector<double> change(n * n);
            double square = 0.0;
            for (std::size_t i = 0; i < n; ++i) {
                double reach = LEAST_SIZE;
                for (std::size_t q = 0; q < p; ++q) reach += own.psi[(j * n + i) * p + q] * rho[q];
                for (std::size_t c = 0; c < n; ++c) {
                    change[i * n + c] = UP * reach * theta[c];
                    const double scaled = change[i * n + c] / (own.scale[i] * own.scale[c]);
                    square += scaled * scaled;
                }
            }
            delta[j] = UP * std::sqrt(square) + LEAST_MARGIN;
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t a = 0; a < n; ++a)
                    for (std::size_t c = 0; c < n; ++c)
                        moved[a * n + c] += size_S[(j * n + i) * n + a] * change[i * n + c];
        }
        double square = 0.0;
        for (std::size_t a = 0; a < n; ++a)
            for (std::size_t c = 0; c < n; ++c) {
                const double scaled = moved[a * n + c] / (own.scale[a] * own.scale[c]);
                square += scaled * scaled;
            }
        // the symmetric part of V stays as it is where the change of V is skew
        eta[g] = own.slack ? 0.0 : 2 * UP * UP * std::sqrt(square) + LEAST_MARGIN;
        return true;
    }

    // Entry of [S_j, B_j], or of B_j.
    const Whole<K> &form(std::size_t j, std::size_t i, std::size_t q) const {
        if (!own.slack) return B[j][i][q];
        return q < n ? S[j][i][q] : B[j][i][q - n];
    }
    // What the change of X has to make up for: E, and of V the skew part.
    Whole<K> wanted(std::size_t g, std::size_t q, std::size_t c) const {
        if (!own.slack) return E[g][q][c];
        if (q >= n) return E[g][q - n][c];
        Whole<K> value = V[g][q][c];
        value -= V[g][c][q];
        return value;  // twice of it
    }

    // Whether all anchors are positive definite at a radius with what is left of W's or G's equation,
    // less the margins; with right-hand sides tau's inequality too.
    Sign at(const Double &r) const {
        const Int fine = std::max<Int>(-r.exponent, 0), longest = own.Y.bits();
        const auto parts = static_cast<Int>(own.joint ? own.N : 1);
        const Whole<K> radius = r.over<K>(std::min<Int>(r.exponent, 0));
        const Whole<K> factor = denominator * radius, whole = Whole<K>(2 * parts) * factor;
        const double value = std::ldexp(static_cast<double>(r.mantissa), static_cast<int>(r.exponent));
        Whole<K> bracket;
        const auto rest = static_cast<Int>(std::max<std::size_t>(own.N - 1, 1));
        for (std::size_t b = 0; b < own.blocks; ++b) {
            if (zero[b] || !(anchor(b) || own.right_hand_sides)) continue;
            Whole<K> trace;
            if (anchor(b)) {
                const std::size_t k = kind(b);
                Matrix<K> block(2 * n, 2 * n);  // on and above the diagonal
                for (std::size_t i = 0; i < 2 * n; ++i)
                    for (std::size_t c = i; c < 2 * n; ++c) block[i][c] = whole * Y[b][i][c];
                const double margin = UP * (delta[b] + eta[k] / (2 * static_cast<double>(parts) * value));
                if (!std::isfinite(margin)) return Sign::not_positive;
                int power = 0;
                std::frexp(margin, &power);
                for (std::size_t i = 0; i < n; ++i) {
                    for (std::size_t c = i; c < n; ++c) {
                        Whole<K> excess = V[k][i][c];
                        excess += V[k][c][i];
                        excess = excess << fine;
                        excess -= factor * sums[k][i][c];
                        block[i][c] += excess;
                        block[n + i][n + c] += excess;
                    }
                    const Int shift = std::max<Int>(power + 2 * own.power[i] - own.Y.least, 0);
                    if (shift > longest + 1) return Sign::not_positive;
                    block[i][i] -= whole << shift;
                    block[n + i][n + i] -= whole << shift;
                }
                const Sign sign = positive_definite(block);
                if (sign != Sign::positive) return sign;
                for (std::size_t i = 0; i < n; ++i) trace += block[i][i];
            } else {
                Whole<K> sum;
                for (std::size_t i = 0; i < n; ++i) sum += Y[b][i][i];
                trace = whole * sum;
            }
            if (!own.right_hand_sides) continue;
            const Int count = static_cast<Int>(own.N), sixteen = count + count * (count - 1);
            const auto number = static_cast<Int>(b);
            const Whole<K> weight(number < count ? rest * rest : number < sixteen ? -1 : -6);
            bracket.add(weight, trace);
        }
        return bracket.negative() ? Sign::not_positive : Sign::positive;
    }
};

template <int K>
int Bound::decide() const {
    return Search<K>(*this).first();
}

// Which S_j W_k + B_j Z_k each block sums: `block_pairs` of polefence/proof/lower.py. The vertices'
// own blocks come first, and those of `joint` conditions have one W.
std::vector<Pairing> pairs_of(bool joint, std::size_t N) {
    std::vector<Pairing> pairs;
    for (std::size_t j = 0; j < N; ++j) pairs.push_back({j, j, joint ? 0 : j});
    if (joint) return pairs;
    std::size_t block = N;
    for (std::size_t j = 0; j < N; ++j)
        for (std::size_t k = 0; k < N; ++k) {
            if (j == k) continue;
            for (const auto &[a, b] : {std::pair{j, j}, std::pair{j, k}, std::pair{k, j}})
                pairs.push_back({block, a, b});
            ++block;
        }
    for (std::size_t j = 0; j < N; ++j)
        for (std::size_t k = j + 1; k < N; ++k)
            for (std::size_t l = k + 1; l < N; ++l) {
                for (const auto &[a, b] : {std::pair{j, k}, std::pair{j, l}, std::pair{k, j},
                                           std::pair{k, l}, std::pair{l, j}, std::pair{l, k}})
                    pairs.push_back({block, a, b});
                ++block;
            }
    return pairs;
}

int lower(bool slack, bool right_hand_sides, bool joint, const PlantArrays &given_plant, double sigma, const Doubles &given_Y, const Doubles &given_Psi,
          const Vector &scale, const Rows &rho, const Vector &radii) {
    const std::size_t N = given_Psi.shape(0), n = given_Psi.shape(1), p = given_Psi.shape(2);
    Plant plant(given_plant, std::get<0>(given_plant).shape(1));
    require(N > 0 && plant.powers.size() == N && plant.n == n, "Psi does not fit");
    const std::size_t m = plant.columns - n, blocks = given_Y.shape(0), kinds = joint ? 1 : N;
    require(p == (slack ? n + m : m), "Psi does not fit");
    require(!slack || joint, "the slack condition has one G");
    require(!right_hand_sides || !joint, "right-hand sides are of Theorem 1");
    require(blocks >= N && given_Y.shape(1) == 2 * n && given_Y.shape(2) == 2 * n, "Y does not fit");
    require(scale.shape(0) == n && rho.shape(0) == kinds && rho.shape(1) == p, "scales do not fit");
    require(std::isfinite(sigma), "sigma is not finite");
    Bound bound{slack, right_hand_sides, joint, N, n, m, p, blocks, kinds, {}, std::move(plant),
                Double(sigma), {}, {}, {}, {}, {}, {}, {}};
    bound.pairs = pairs_of(joint, N);
    require(blocks == bound.pairs.back().block + 1, "Y does not fit");
    bound.Y.take(given_Y.data(), blocks * 4 * n * n);
    bound.Psi.take(given_Psi.data(), N * n * p);
    bound.Psi.include(0);
    for (std::size_t i = 0; i < N * n * p; ++i) bound.psi.push_back(std::fabs(given_Psi.data()[i]));
    for (std::size_t i = 0; i < n; ++i) {
        int power = 0;
        const double own = scale.data()[i];
        require(own > SMALL && own < LARGE && std::frexp(own, &power) == 0.5, "scales are powers of two");
        bound.scale.push_back(own);
        bound.power.push_back(power - 1);
    }
    for (std::size_t i = 0; i < kinds * p; ++i) {
        require(rho.data()[i] > SMALL && rho.data()[i] < LARGE, "scales are 1e-60 to 1e60");
        bound.rho.push_back(rho.data()[i]);
    }
    for (std::size_t i = 0; i < radii.shape(0); ++i) {
        require(radii.data()[i] > SMALL && radii.data()[i] < LARGE, "radii are 1e-60 to 1e60");
        bound.radii.emplace_back(radii.data()[i]);
    }
    return in_words(bound, UNKNOWN);
}

}  // namespace

void add_bound(nb::module_ &module) {
    module.def("lower", &lower, nb::arg("slack"), nb::arg("right_hand_sides"), nb::arg("joint"),
               nb::arg("plant"), nb::arg("sigma"), nb::arg("Y"), nb::arg("Psi"),
               nb::arg("scale"), nb::arg("rho"), nb::arg("radii"));
}

#else

void add_bound(nanobind::module_ &) {}

#endif
