// What a search measures of laws at points, with slopes: the twin of search/tune/measures.py.
// Compiled once, for any processor: its rows are the same on all of them.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <vector>

#include "kernel.hpp"

namespace nb = nanobind;

namespace {

using Int = std::int64_t;
using Complex = std::complex<double>;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double residual = 1e-9;  // of an equation, as response/modes.py takes it
constexpr int most_refined = 3;    // times that what is left of it is solved for
constexpr double close = 1e-8;     // of a trace, as search/tune/smooth.py takes it

template <int D>
using In = nb::ndarray<const double, nb::ndim<D>, nb::c_contig, nb::device::cpu>;
template <int D>
using InComplex = nb::ndarray<const Complex, nb::ndim<D>, nb::c_contig, nb::device::cpu>;
using Integers = nb::ndarray<const Int, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

void require(bool fine, const char *message) {
    if (!fine) throw nb::value_error(message);
}

// Without the checks of a general product for what is not finite.
Complex times(Complex a, Complex b) {
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

// a conj(b)
Complex against(Complex a, Complex b) {
    return {a.real() * b.real() + a.imag() * b.imag(), a.imag() * b.real() - a.real() * b.imag()};
}

double square(Complex a) { return a.real() * a.real() + a.imag() * a.imag(); }

// Loops A = (..) + B K with their poles and eigenvectors; states of filters come last.
struct Modes {
    Int n;
    const double *A, *B;
    const Complex *poles, *right, *left;
};

// x' = A x + E w of some modes.
struct Source {
    Int modes, q;
    const double *E;
};

// z = (C + D K) x of a source: the root of the mean of z' z and `more` is measured.
struct Noise {
    Int source, p;
    const double *C, *D, *more;
};

// r of {z : L0 + r L1 + (M0 + r M1) z + (M0 + r M1)' conj(z) < 0}, one or two rows.
struct Side {
    Int p;
    const double *L0, *L1, *M0, *M1;
};

// A smooth measure of a side, as search/tune/smooth.py has it; its trace is to be `most`.
struct Curve {
    Int side;
    double a[3];
    Complex b[2];
    double e, s, most;
};

enum Kind : Int { of_side, of_speed, of_entries, of_noise, of_size, of_curve };
enum Bend : Int { kept, in_units, at_most };  // value / limit + shift; value / unit; below most

struct Measure {
    Kind kind;
    Int number, group;
    Bend bend;
    double limit, shift;
};

struct Question {
    Int laws, count;       // points of each law
    Int m, r, terms, numbers;
    double step, fastest;  // of delta forms; of poles
    bool needs_decay, first, slopes;
    const double *K, *C, *term, *pattern, *largest, *weight;
    const double *unit, *most;  // of each law
    std::vector<Modes> modes;
    std::vector<Source> sources;
    std::vector<Noise> noises;
    std::vector<Side> sides;
    std::vector<Curve> curves;
    std::vector<Measure> measures;
};

// Of one source at one point: X, X + step A X, and whether modes alone did not solve for it.
struct Covariance {
    bool solved = false, refined = false;
    std::vector<double> X, moved;
};

enum Status : Int { fine, impossible, hard };  // hard: without modes

class Laws {
  public:
    explicit Laws(const Question &question) : q(question) {
        Int widest = 1;
        for (const Modes &own : q.modes) widest = std::max(widest, own.n);
        Int most_rows = std::max({widest, q.m, q.r});
        for (const Noise &own : q.noises) most_rows = std::max(most_rows, own.p);
        for (const Source &own : q.sources) most_rows = std::max(most_rows, own.q);
        const auto size = static_cast<std::size_t>(widest * std::max(widest, most_rows));
        for (auto *own : {&half, &whole}) own->resize(size);
        if (!q.curves.empty())
            for (auto *own : {&P, &G, &S, &X, &Q, &powers[0], &powers[1], &powers[2]}) own->resize(size);
        for (auto *own : {&product, &weights, &observed, &dA, &closed, &shown, &left_over, &correction})
            own->resize(size);
        covariances.resize(q.sources.size());
        for (Covariance &own : covariances) own.X.resize(size);
        for (auto *own : {&real, &imaginary}) own->resize(size);
        line.resize(2 * static_cast<std::size_t>(widest));
        for (auto *own : {&thin_real, &thin_imaginary}) own->resize(size);
        pushed.resize(static_cast<std::size_t>(q.m * widest));
        for (auto *own : {&full, &states_gain}) own->resize(static_cast<std::size_t>(q.m * widest));
        gain.resize(static_cast<std::size_t>(q.m * q.r));
        flat.resize(static_cast<std::size_t>(q.numbers));
        ahead.resize(static_cast<std::size_t>(q.modes[0].n * q.m));
        behind.resize(static_cast<std::size_t>(q.modes[0].n * q.r));
    }

    void go() {
        if (!q.slopes) worst.resize(q.measures.size() * static_cast<std::size_t>(q.laws * q.count));
        for (Int law = 0; law < q.laws; ++law) {
            const std::size_t begin = values.size();
            Int state = fine;
            for (Int k = 0; k < q.count && state == fine; ++k) state = point(law, law * q.count + k);
            if (state == fine && q.slopes && !finite_from(begin)) state = impossible;
            if (state != fine) {
                values.resize(begin);
                groups.resize(begin);
                objective.resize(begin);
                slopes.resize(begin * width());
            }
            status.push_back(state);
            ends.push_back(static_cast<Int>(values.size()));
        }
    }

    Int width() const { return q.slopes ? q.terms * q.numbers : 0; }

    std::vector<double> values, slopes;
    std::vector<Int> groups, status, ends;
    std::vector<unsigned char> objective;
    std::vector<double> worst;  // measures x points, where slopes are not asked for

  private:
    bool finite_from(std::size_t begin) const {
        const auto good = [](double x) { return std::isfinite(x); };
        return std::all_of(values.begin() + static_cast<std::ptrdiff_t>(begin), values.end(), good) &&
               std::all_of(slopes.begin() + static_cast<std::ptrdiff_t>(begin) * width(), slopes.end(),
                           good);
    }

    Int point(Int law, Int at) {
        const Modes &plain = q.modes[0];
        const Complex *poles = plain.poles + at * plain.n;
        const bool decays = decay(poles, plain.n);
        if (q.needs_decay && !decays && q.slopes) return impossible;
        this->law = law;
        place = at;
        for (Covariance &known : covariances) known.solved = false;
        turn(at);
        for (const Measure &measure : q.measures) {
            now = &measure;
            const auto number = &measure - q.measures.data();
            peak = -infinity;
            if (!q.slopes && q.needs_decay && !decays && (measure.group == 0 || measure.kind == of_noise)) {
                peak = infinity;  // what is minimised, and requirements
            } else if (measure.kind == of_side) {
                of_poles(poles, plain.n, [&](Complex z, double *dx, double *dy) {
                    return growth(q.sides[static_cast<std::size_t>(measure.number)], z, dx, dy);
                });
            } else if (measure.kind == of_speed) {
                of_poles(poles, plain.n, [&](Complex z, double *dx, double *dy) {
                    const double size = std::max(std::sqrt(square(z)), std::numeric_limits<double>::min());
                    *dx = z.real() / size / q.fastest;
                    *dy = z.imag() / size / q.fastest;
                    return size / q.fastest;
                });
            } else if (measure.kind == of_entries) {
                entries();
            } else if (measure.kind == of_size) {
                size();
            } else if (measure.kind == of_curve) {
                smooth(q.curves[static_cast<std::size_t>(measure.number)], poles);
            } else if (!noise(q.noises[static_cast<std::size_t>(measure.number)])) {
                return hard;
            }
            if (!q.slopes) worst[static_cast<std::size_t>(number * q.laws * q.count + at)] = peak;
        }
        return fine;
    }

    bool decay(const Complex *poles, Int n) const {
        double largest = 0;
        for (Int i = 0; i < n; ++i) largest = std::max(largest, square(poles[i]));
        largest = std::sqrt(largest);
        for (Int i = 0; i < n; ++i)
            if (!(rate(poles[i]) < -1e-12 * largest)) return false;
        return true;
    }

    // Re p, or (|1 + step p| - 1) / step.
    double rate(Complex p) const {
        return (2 * p.real() + q.step * square(p)) / (1 + std::sqrt(square(1.0 + q.step * p)));
    }

    // --- poles ---

    // K C, each left eigenvector times B, and C times each right one.
    void turn(Int at) {
        const Modes &modes = q.modes[0];
        const Complex *right = modes.right + at * modes.n * modes.n, *left = modes.left + at * modes.n * modes.n;
        const double *B = modes.B + at * modes.n * q.m, *C = q.C + at * q.r * modes.n, *K = q.K + at * q.m * q.r;
        for (Int i = 0; i < q.m; ++i)
            for (Int j = 0; j < modes.n; ++j) {
                double sum = 0;
                for (Int k = 0; k < q.r; ++k) sum += K[i * q.r + k] * C[k * modes.n + j];
                states_gain[cell(i, j, modes.n)] = sum;
            }
        if (!q.slopes) return;
        std::fill(ahead.begin(), ahead.end(), Complex(0));
        std::fill(behind.begin(), behind.end(), Complex(0));
        for (Int i = 0; i < modes.n; ++i)
            for (Int k = 0; k < modes.n; ++k) {
                for (Int j = 0; j < q.m; ++j) ahead[cell(i, j, q.m)] += left[i * modes.n + k] * B[k * q.m + j];
                for (Int j = 0; j < q.r; ++j) behind[cell(i, j, q.r)] += C[j * modes.n + k] * right[k * modes.n + i];
            }
    }

    template <class Function>
    void of_poles(const Complex *poles, Int n, Function function) {
        for (Int i = 0; i < n; ++i) {
            if (!(poles[i].imag() >= 0)) continue;
            double dx = 0, dy = 0;
            const double value = function(poles[i], &dx, &dy);
            if (q.slopes)
                for (Int j = 0; j < q.m; ++j)
                    for (Int k = 0; k < q.r; ++k) {
                        const Complex move = times(ahead[cell(i, j, q.m)], behind[cell(i, k, q.r)]);
                        gain[cell(j, k, q.r)] = dx * move.real() + dy * move.imag();
                    }
            row(value);
        }
    }

    // The least r of a pole, and its slopes along both axes.
    static double growth(const Side &side, Complex z, double *dx, double *dy) {
        const double x = z.real(), y = z.imag();
        if (side.p == 1) {
            const double H1 = side.L1[0] + 2 * side.M1[0] * x;
            const double r = (side.L0[0] + 2 * side.M0[0] * x) / -H1;
            *dx = 2 * (side.M0[0] + r * side.M1[0]) / -H1;
            *dy = 0;
            return r;
        }
        // H = h + i g for both; -H1 = T T', and r is the largest eigenvalue of T^-1 H0 T'^-1
        const auto corner = [&](const double *L, const double *M) {
            return Complex(L[1] + (M[1] + M[2]) * x, (M[1] - M[2]) * y);
        };
        const double a1 = -(side.L1[0] + 2 * side.M1[0] * x), d1 = -(side.L1[3] + 2 * side.M1[3] * x);
        const Complex b1 = -corner(side.L1, side.M1);
        const double a0 = side.L0[0] + 2 * side.M0[0] * x, d0 = side.L0[3] + 2 * side.M0[3] * x;
        const Complex b0 = corner(side.L0, side.M0);
        const double t = std::sqrt(a1);
        const Complex s = std::conj(b1) / t;
        const double u = std::sqrt(d1 - square(s));
        // columns of T'^-1: (1 / t, 0) and (-s* / (t u), 1 / u)
        const Complex w = -std::conj(s) / (t * u);
        const double a = a0 / (t * t), v = 1 / u;
        const Complex b = (a0 * w + b0 * v) / t;
        const double d = a0 * square(w) + 2 * v * times(std::conj(w), b0).real() + d0 * v * v;
        const double middle = (a + d) / 2, apart = (a - d) / 2, far = std::hypot(apart, std::sqrt(square(b)));
        const double r = middle + far;
        Complex e0 = 1, e1 = 0;
        if (far > 0) {
            if (apart >= 0) {
                e0 = apart + far;
                e1 = std::conj(b);
            } else {
                e0 = b;
                e1 = far - apart;
            }
            const double length = std::sqrt(square(e0) + square(e1));
            e0 /= length;
            e1 /= length;
        }
        const Complex v0 = e0 / t + times(w, e1), v1 = v * e1;
        double M[4];
        for (int i = 0; i < 4; ++i) M[i] = side.M0[i] + r * side.M1[i];
        // v* M v: its real part twice along the real axis, less its imaginary part along the other
        const Complex along = M[0] * square(v0) + M[3] * square(v1) + M[1] * against(v1, v0) + M[2] * against(v0, v1);
        *dx = 2 * along.real();
        *dy = -2 * along.imag();
        return r;
    }

    // --- poles, smoothly ---

    // The trace of X, a + b z_i + b* z_j* + e z_i z_j* of each two modes negative, at r.
    double trace(double r) const {
        const Int n = q.modes[0].n;
        double sum = 0;
        for (Int i = 0; i < n; ++i)
            for (Int j = i; j < n; ++j) {
                const std::size_t at = cell(i, j, n);
                const Complex D = powers[0][at] + r * (powers[1][at] + r * powers[2][at]);
                sum -= (j > i ? 2 : 1) * against(S[at], D).real() / square(D);
            }
        return sum;
    }

    // The least r above `low` at which the trace, which falls, is at most a number.
    double least(double low, double most) const {
        const double aim = 1 / most, size = std::max(std::fabs(low), 1e-12);
        double below = low, under = 0, step = 1e-3 * size, above = low + step, over = 1 / trace(above);
        for (int k = 0; k < 40 && !(over >= aim); ++k) {
            below = above;
            under = over;
            step *= 16;
            above = low + step;
            over = 1 / trace(above);
        }
        for (int k = 0; k < 40; ++k) {
            double share = 0.5;  // every third time, so that it ends
            if (k % 3 != 2) {
                share = (aim - under) / std::max(over - under, std::numeric_limits<double>::min());
                share = std::min(std::max(share, 1e-3), 1 - 1e-3);
            }
            const double next = below + (above - below) * share, value = 1 / trace(next);
            (value >= aim ? above : below) = next;
            (value >= aim ? over : under) = value;
            if (std::fabs(over - aim) <= close * aim || above - below <= close * size) break;
        }
        return above;
    }

    void smooth(const Curve &curve, const Complex *z) {
        const Modes &modes = q.modes[0];
        const Int n = modes.n;
        const Complex *V = modes.right + place * n * n, *U = modes.left + place * n * n;
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                Complex left = 0, right = 0;
                for (Int k = 0; k < n; ++k) {
                    left += against(U[i * n + k], U[j * n + k]);
                    right += against(V[k * n + j], V[k * n + i]);
                }
                const std::size_t at = cell(i, j, n);
                P[at] = left;
                G[at] = right;
                S[at] = curve.s * against(left, right);
                const Complex both = against(z[i], z[j]);
                for (std::size_t k = 0; k < 3; ++k) {
                    powers[k][at] = curve.a[k];
                    if (k < 2) powers[k][at] += times(curve.b[k], z[i]) + std::conj(times(curve.b[k], z[j]));
                }
                powers[0][at] += curve.e * both;
            }
        double low = -infinity, dx = 0, dy = 0;
        for (Int i = 0; i < n; ++i) {
            const Complex upper(z[i].real(), std::fabs(z[i].imag()));
            low = std::max(low, growth(q.sides[static_cast<std::size_t>(curve.side)], upper, &dx, &dy));
        }
        const double r = least(low, curve.most);
        if (q.slopes) turn_smooth(curve, modes, V, U, r);
        row(r);
    }

    void turn_smooth(const Curve &curve, const Modes &modes, const Complex *V, const Complex *U, double r) {
        const Int n = modes.n;
        const double *A = modes.A + place * n * n;
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                const std::size_t at = cell(i, j, n);
                const Complex D = powers[0][at] + r * (powers[1][at] + r * powers[2][at]);
                S[at] = curve.s * P[at] / -D;
                P[at] = G[at] / -std::conj(D);  // D' is its conjugate
            }
        // X = V (..) V*, Q = U* (..) U
        multiply(n, [&](Int i, Int k) { return V[i * n + k]; }, [&](Int k, Int j) { return S[cell(k, j, n)]; }, half);
        multiply(n, [&](Int i, Int k) { return half[cell(i, k, n)]; }, [&](Int k, Int j) { return std::conj(V[j * n + k]); }, X);
        multiply(n, [&](Int i, Int k) { return std::conj(U[k * n + i]); }, [&](Int k, Int j) { return P[cell(k, j, n)]; }, half);
        multiply(n, [&](Int i, Int k) { return half[cell(i, k, n)]; }, [&](Int k, Int j) { return U[k * n + j]; }, Q);
        const Complex b = curve.b[0] + r * curve.b[1], db = curve.b[1];
        const double da = curve.a[1] + 2 * r * curve.a[2];
        // fall: of the trace of Q (da X + 2 db A X)
        double fall = 0;
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                Complex change = da * X[cell(i, j, n)];
                if (db != 0.0) {
                    Complex sum = 0;
                    for (Int k = 0; k < n; ++k) sum += A[i * n + k] * X[cell(k, j, n)];
                    change += 2.0 * times(db, sum);
                }
                fall += times(Q[cell(j, i, n)], change).real();
            }
        // b X Q + e X A' Q
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                Complex sum = times(b, X[cell(i, j, n)]);
                if (curve.e != 0)
                    for (Int k = 0; k < n; ++k) sum += curve.e * A[j * n + k] * X[cell(i, k, n)];
                half[cell(i, j, n)] = sum;
            }
        const double *B = modes.B + place * n * q.m, *C = q.C + place * q.r * n;
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                double sum = 0;
                for (Int k = 0; k < n; ++k) sum += times(half[cell(j, k, n)], Q[cell(k, i, n)]).real();
                dA[cell(i, j, n)] = -2 * sum / fall;
            }
        for (Int k = 0; k < q.m; ++k)
            for (Int j = 0; j < n; ++j) {
                double sum = 0;
                for (Int i = 0; i < n; ++i) sum += B[i * q.m + k] * dA[cell(i, j, n)];
                full[cell(k, j, n)] = sum;
            }
        seen(C, n);
    }

    template <class Left, class Right>
    static void multiply(Int n, Left left, Right right, std::vector<Complex> &out) {
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                Complex sum = 0;
                for (Int k = 0; k < n; ++k) sum += times(left(i, k), right(k, j));
                out[cell(i, j, n)] = sum;
            }
    }

    // Slopes with respect to the gain of what is measured, from those in `full`.
    void seen(const double *C, Int n) {
        for (Int k = 0; k < q.m; ++k)
            for (Int j = 0; j < q.r; ++j) {
                double sum = 0;
                for (Int i = 0; i < n; ++i) sum += full[cell(k, i, n)] * C[j * n + i];
                gain[cell(k, j, q.r)] = sum;
            }
    }

    // --- the law itself ---

    void entries() {
        const double *K = q.K + place * q.m * q.r, *largest = q.largest;
        for (Int e = 0; e < q.m * q.r; ++e) {
            if (!std::isfinite(largest[e])) continue;
            std::fill(gain.begin(), gain.end(), 0.0);
            gain[static_cast<std::size_t>(e)] = (K[e] > 0 ? 1 : K[e] < 0 ? -1 : 0) / largest[e];
            row(std::fabs(K[e]) / largest[e]);
        }
    }

    void size() {
        const double *K = q.K + place * q.m * q.r;
        double sum = 0;
        for (Int e = 0; e < q.m * q.r; ++e) sum += K[e] * q.weight[e] * K[e] * q.weight[e];
        const double value = std::sqrt(sum), length = value > 0 ? value : 1;
        for (Int e = 0; e < q.m * q.r; ++e)
            gain[static_cast<std::size_t>(e)] = K[e] * q.weight[e] * q.weight[e] / length;
        row(value);
    }

    // --- noise ---

    // Whether X solves A X + X A' + step A X A' + W = 0, W in `weights`, or A' X + ... where turned.
    // Ill-conditioned eigenvectors leave a residual, which is solved for in the same way.
    bool refine(const Modes &modes, bool turned, double *X) {
        const Int size = modes.n * modes.n;
        const double *A = modes.A + place * size;
        for (int k = 0; !solves(A, modes.n, turned, X); ++k) {
            if (k == most_refined) return false;
            by_modes(modes, turned, left_over, correction.data());
            for (Int i = 0; i < size; ++i) X[i] += correction[static_cast<std::size_t>(i)];
        }
        return true;
    }

    void by_modes(const Modes &modes, bool turned, const std::vector<double> &W, double *X) {
        const Int n = modes.n;
        const Complex *p = modes.poles + place * n, *V = modes.right + place * n * n;
        const Complex *U = modes.left + place * n * n;
        // V (U W U* / -t) V*, or U* (V* W V / -t*) U
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                Complex sum = 0;
                for (Int k = 0; k < n; ++k)
                    sum += W[cell(k, j, n)] * (turned ? std::conj(V[k * n + i]) : U[i * n + k]);
                half[cell(i, j, n)] = sum;
            }
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                Complex sum = 0;
                for (Int k = 0; k < n; ++k)
                    sum += turned ? times(half[cell(i, k, n)], V[k * n + j]) : against(half[cell(i, k, n)], U[j * n + k]);
                const Complex t = total(p[i], p[j]);
                whole[cell(i, j, n)] = sum / -(turned ? std::conj(t) : t);
            }
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                Complex sum = 0;
                for (Int k = 0; k < n; ++k)
                    sum += turned ? against(whole[cell(k, j, n)], U[k * n + i]) : times(V[i * n + k], whole[cell(k, j, n)]);
                half[cell(i, j, n)] = sum;
            }
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                double sum = 0;
                for (Int k = 0; k < n; ++k)
                    sum += (turned ? times(half[cell(i, k, n)], U[k * n + j]) : against(half[cell(i, k, n)], V[j * n + k])).real();
                product[cell(i, j, n)] = sum;
            }
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j)
                X[i * n + j] = (product[cell(i, j, n)] + product[cell(j, i, n)]) / 2;
    }

    bool solves(const double *A, Int n, bool turned, const double *X) {
        double largest = 0, size = 0, rest = 0;
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                double sum = 0;
                for (Int k = 0; k < n; ++k) sum += (turned ? A[k * n + i] : A[i * n + k]) * X[j * n + k];
                product[cell(i, j, n)] = sum;
                largest = std::max(largest, std::fabs(sum));
            }
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                const double W = weights[cell(i, j, n)];
                double left = product[cell(i, j, n)] + product[cell(j, i, n)] + W;
                if (q.step != 0)
                    for (Int k = 0; k < n; ++k)
                        left += q.step * product[cell(i, k, n)] * (turned ? A[k * n + j] : A[j * n + k]);
                if (!(std::fabs(left) < infinity)) return false;
                left_over[cell(i, j, n)] = left;
                rest = std::max(rest, std::fabs(left));
                size = std::max(size, std::fabs(W));
            }
        return rest <= residual * (largest + size);
    }

    bool noise(const Noise &signal) {
        const Source &source = q.sources[static_cast<std::size_t>(signal.source)];
        const Modes &modes = q.modes[static_cast<std::size_t>(source.modes)];
        const Int n = modes.n, p = signal.p;
        Covariance &known = covariances[static_cast<std::size_t>(signal.source)];
        if (!known.solved && !covariance(source, modes, known)) return false;
        const double *X = known.X.data();
        const Int plain = q.modes[0].n;
        const double *open = signal.C + place * p * n, *D = signal.D + place * p * q.m, *C = closed.data();
        for (Int i = 0; i < p; ++i)
            for (Int j = 0; j < n; ++j) {
                double along = open[i * n + j];
                for (Int k = 0; k < q.m && j < plain; ++k)
                    along += D[i * q.m + k] * states_gain[cell(k, j, plain)];
                closed[cell(i, j, n)] = along;
            }
        double sum = signal.more[place];
        for (Int i = 0; i < p; ++i)
            for (Int j = 0; j < n; ++j) {
                double along = 0;
                for (Int k = 0; k < n; ++k) along += C[i * n + k] * X[k * n + j];
                shown[cell(i, j, n)] = along;
                sum += along * C[i * n + j];
            }
        const double value = std::sqrt(std::max(sum, 0.0));
        if (q.slopes && !turn_noise(signal, modes, known, value > 0 ? value : 1)) return false;
        row(value);
        return true;
    }

    // X of one source, by X = V Y V*, Y = U E E' U* / -t.
    bool covariance(const Source &source, const Modes &modes, Covariance &known) {
        const Int n = modes.n, w = source.q;
        const double *E = source.E + place * n * w, *A = modes.A + place * n * n;
        const Complex *U = modes.left + place * n * n, *V = modes.right + place * n * n;
        for (Int k = 0; k < w; ++k)
            for (Int i = 0; i < n; ++i) {
                Complex sum = 0;
                for (Int j = 0; j < n; ++j) sum += U[i * n + j] * E[j * w + k];
                thin_real[cell(k, i, n)] = sum.real();
                thin_imaginary[cell(k, i, n)] = sum.imag();
            }
        const Complex *p = modes.poles + place * n;
        for (Int i = 0; i < n; ++i) {
            squares(w, n, i);
            for (Int j = 0; j < n; ++j) {
                const Complex own = Complex(line[cell(0, j, n)], -line[cell(1, j, n)]) / -total(p[i], p[j]);
                real[cell(i, j, n)] = own.real();
                imaginary[cell(i, j, n)] = own.imag();
            }
        }
        std::vector<double> &X = known.X;
        for (Int i = 0; i < n; ++i) {
            double *Zr = line.data(), *Zi = Zr + n;
            std::fill(Zr, Zi + n, 0.0);
            for (Int k = 0; k < n; ++k) {
                const double Vr = V[i * n + k].real(), Vi = V[i * n + k].imag();
                const double *Yr = real.data() + k * n, *Yi = imaginary.data() + k * n;
                for (Int j = 0; j < n; ++j) {
                    Zr[j] += Vr * Yr[j] - Vi * Yi[j];
                    Zi[j] += Vr * Yi[j] + Vi * Yr[j];
                }
            }
            for (Int j = 0; j <= i; ++j) {
                double sum = 0;
                for (Int k = 0; k < n; ++k) sum += Zr[k] * V[j * n + k].real() + Zi[k] * V[j * n + k].imag();
                X[cell(i, j, n)] = X[cell(j, i, n)] = sum;
            }
        }
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                double sum = 0;
                for (Int k = 0; k < w; ++k) sum += E[i * w + k] * E[j * w + k];
                weights[cell(i, j, n)] = sum;
            }
        known.refined = !solves(A, n, false, X.data());
        if (known.refined && !refine(modes, false, X.data())) return false;
        known.moved = X;
        if (q.step != 0)
            for (Int i = 0; i < n; ++i)
                for (Int k = 0; k < n; ++k)
                    for (Int j = 0; j < n; ++j)
                        known.moved[cell(i, j, n)] += q.step * A[i * n + k] * X[cell(k, j, n)];
        return known.solved = true;
    }

    // Of row i of H* H, H the rows in `thin_real` and `thin_imaginary`: real parts, then imaginary.
    void squares(Int rows, Int n, Int i) {
        double *re = line.data(), *im = re + n;
        std::fill(re, im + n, 0.0);
        for (Int k = 0; k < rows; ++k) {
            const double *Hr = thin_real.data() + k * n, *Hi = thin_imaginary.data() + k * n;
            const double own = Hr[i], other = Hi[i];
            for (Int j = 0; j < n; ++j) {
                re[j] += own * Hr[j] + other * Hi[j];
                im[j] += own * Hi[j] - other * Hr[j];
            }
        }
    }

    Complex total(Complex left, Complex right) const {
        return left + std::conj(right) + q.step * against(left, right);
    }

    // B' Q of A' Q + Q A + C' C = 0 and so on, (m, n), into `pushed`: by B' U* Y U, Y = V* C' C V / -t*.
    bool observed_inputs(const Modes &modes, Int p, bool refined) {
        const Int n = modes.n, m = q.m;
        const double *B = modes.B + place * n * m, *C = closed.data();
        if (refined) {
            for (Int i = 0; i < n; ++i)
                for (Int j = 0; j < n; ++j) {
                    double sum = 0;
                    for (Int k = 0; k < p; ++k) sum += C[k * n + i] * C[k * n + j];
                    weights[cell(i, j, n)] = sum;
                }
            by_modes(modes, true, weights, observed.data());
            if (!refine(modes, true, observed.data())) return false;
            for (Int k = 0; k < m; ++k)
                for (Int j = 0; j < n; ++j) {
                    double sum = 0;
                    for (Int i = 0; i < n; ++i) sum += B[i * m + k] * observed[cell(i, j, n)];
                    pushed[cell(k, j, n)] = sum;
                }
            return true;
        }
        const Complex *U = modes.left + place * n * n, *V = modes.right + place * n * n;
        const Complex *poles = modes.poles + place * n;
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < n; ++j) {
                real[cell(i, j, n)] = V[i * n + j].real();
                imaginary[cell(i, j, n)] = V[i * n + j].imag();
            }
        for (Int k = 0; k < p; ++k) {
            double *re = thin_real.data() + k * n, *im = thin_imaginary.data() + k * n;
            std::fill(re, re + n, 0.0);
            std::fill(im, im + n, 0.0);
            for (Int i = 0; i < n; ++i)
                if (const double own = C[k * n + i]; own != 0)
                    for (Int j = 0; j < n; ++j) {
                        re[j] += own * real[cell(i, j, n)];
                        im[j] += own * imaginary[cell(i, j, n)];
                    }
        }
        for (Int i = 0; i < n; ++i)
            for (Int k = 0; k < m; ++k) {
                Complex sum = 0;
                for (Int j = 0; j < n; ++j) sum += U[i * n + j] * B[j * m + k];
                half[cell(i, k, m)] = sum;
            }
        std::fill(whole.begin(), whole.begin() + m * n, Complex(0));
        for (Int i = 0; i < n; ++i) {
            squares(p, n, i);
            for (Int j = 0; j < n; ++j) {
                const Complex own = Complex(line[cell(0, j, n)], line[cell(1, j, n)]) / -std::conj(total(poles[i], poles[j]));
                for (Int k = 0; k < m; ++k) whole[cell(k, j, n)] += against(own, half[cell(i, k, m)]);
            }
        }
        std::fill(pushed.begin(), pushed.end(), 0.0);
        for (Int k = 0; k < m; ++k)
            for (Int i = 0; i < n; ++i) {
                const double re = whole[cell(k, i, n)].real(), im = whole[cell(k, i, n)].imag();
                for (Int j = 0; j < n; ++j)
                    pushed[cell(k, j, n)] += re * U[i * n + j].real() - im * U[i * n + j].imag();
            }
        return true;
    }

    // Slopes: Q X over the value with respect to A, times B'; C X over it, times D'.
    bool turn_noise(const Noise &signal, const Modes &modes, const Covariance &known, double value) {
        const Int n = modes.n, p = signal.p, plain = q.modes[0].n;
        if (!observed_inputs(modes, p, known.refined)) return false;
        // no gain is of the states of filters
        const double *D = signal.D + place * p * q.m;
        std::fill(full.begin(), full.end(), 0.0);
        for (Int k = 0; k < q.m; ++k) {
            double *to = full.data() + k * plain;
            for (Int i = 0; i < n; ++i)
                for (Int j = 0; j < plain; ++j) to[j] += pushed[cell(k, i, n)] * known.moved[cell(i, j, n)];
            for (Int i = 0; i < p; ++i)
                for (Int j = 0; j < plain; ++j) to[j] += D[i * q.m + k] * shown[cell(i, j, n)];
            for (Int j = 0; j < plain; ++j) to[j] /= value;
        }
        seen(q.C + place * q.r * plain, plain);
        return true;
    }

    // --- rows ---

    // Adds a row: a value, whose slopes with respect to the gain of what is measured are in `gain`.
    void row(double value) {
        double divisor = 1, bent = value;
        if (now->bend == kept) {
            divisor = now->limit;
            bent = value / now->limit + now->shift;
        } else if (now->bend == in_units) {
            divisor = q.unit[law];
            bent = value / divisor;
        } else {
            divisor = q.most[law] == 0 ? 1 : std::fabs(q.most[law]);
            bent = (value - q.most[law]) / divisor;
        }
        if (!q.slopes) {
            peak = std::isnan(bent) ? bent : std::max(peak, bent);
            return;
        }
        const double start = now->bend == in_units ? 1 : 0, above = std::max(bent - start, 0.0);
        if (bent > start) bent = start + std::log1p(above);
        divisor *= 1 + above;
        values.push_back(bent);
        groups.push_back(now->group * q.count + place - law * q.count);
        objective.push_back(now->bend == in_units || !q.first);
        std::fill(flat.begin(), flat.end(), 0.0);
        for (Int e = 0; e < q.m * q.r; ++e)
            if (const double slope = gain[static_cast<std::size_t>(e)] / divisor; slope != 0)
                for (Int k = 0; k < q.numbers; ++k)
                    flat[static_cast<std::size_t>(k)] += slope * q.pattern[e * q.numbers + k];
        for (Int t = 0; t < q.terms; ++t)
            for (double own : flat) slopes.push_back(q.term[place * q.terms + t] * own);
    }

    static std::size_t cell(Int i, Int j, Int columns) { return static_cast<std::size_t>(i * columns + j); }

    const Question &q;
    const Measure *now = nullptr;
    Int law = 0, place = 0;
    double peak = 0;
    std::vector<Complex> half, whole, ahead, behind, P, G, S, X, Q, powers[3];
    std::vector<double> product, weights, observed, dA, closed, shown, left_over, correction, full, states_gain, gain, flat;
    std::vector<double> real, imaginary, thin_real, thin_imaginary, line, pushed;
    std::vector<Covariance> covariances;
};

template <class T>
nb::ndarray<nb::numpy, T> given(std::vector<T> own, std::vector<std::size_t> shape) {
    auto *kept = new std::vector<T>(std::move(own));
    nb::capsule owner(kept, [](void *data) noexcept { delete static_cast<std::vector<T> *>(data); });
    return nb::ndarray<nb::numpy, T>(kept->data(), shape.size(), shape.data(), owner);
}

using Loops = std::tuple<In<3>, In<3>, InComplex<2>, InComplex<3>, InComplex<3>>;
using Driven = std::tuple<Int, In<3>>;
using Shown = std::tuple<Int, In<3>, In<3>, In<1>>;
using Grown = std::tuple<In<2>, In<2>, In<2>, In<2>>;

template <class Array>
Int extent(const Array &array, std::size_t axis) {
    return static_cast<Int>(array.shape(axis));
}

template <class Array>
bool shaped(const Array &array, std::initializer_list<Int> shape) {
    std::size_t axis = 0;
    for (Int own : shape)
        if (extent(array, axis++) != own) return false;
    return true;
}

// Rows of laws with slopes; or the worst of each measure at each point, without.
nb::tuple rows(Int laws, double step, double fastest, bool needs_decay, bool first, bool slopes,
               const In<3> &K, const In<3> &C, const In<2> &term, const In<2> &pattern,
               const In<2> &largest, const In<2> &weight, const In<1> &unit, const In<1> &most,
               const std::vector<Loops> &modes, const std::vector<Driven> &sources,
               const std::vector<Shown> &noises, const std::vector<Grown> &sides,
               const In<2> &curves, const Integers &measures, const In<2> &bends) {
    const Int points = extent(K, 0), m = extent(K, 1), r = extent(K, 2), n = extent(C, 2);
    require(laws > 0 && points % laws == 0 && !modes.empty(), "laws do not fit");
    Question q{laws, points / laws, m, r, extent(term, 1), extent(pattern, 1), step, fastest,
               needs_decay, first, slopes, K.data(), C.data(), term.data(), pattern.data(),
               largest.data(), weight.data(), unit.data(), most.data(), {}, {}, {}, {}, {}, {}};
    require(shaped(C, {points, r, n}) && shaped(term, {points, q.terms}) &&
                shaped(pattern, {m * r, q.numbers}) && shaped(largest, {m, r}) &&
                shaped(weight, {m, r}) && shaped(unit, {laws}) && shaped(most, {laws}),
            "the law does not fit");
    for (const auto &[A, B, poles, right, left] : modes) {
        const Int size = extent(A, 1);
        require(size >= n && (!q.modes.empty() || size == n) && shaped(A, {points, size, size}) &&
                    shaped(B, {points, size, m}) && shaped(poles, {points, size}) &&
                    shaped(right, {points, size, size}) && shaped(left, {points, size, size}),
                "modes do not fit");
        q.modes.push_back({size, A.data(), B.data(), poles.data(), right.data(), left.data()});
    }
    const auto within = [](Int number, std::size_t count) {
        return number >= 0 && number < static_cast<Int>(count);
    };
    for (const auto &[number, E] : sources) {
        require(within(number, q.modes.size()) &&
                    shaped(E, {points, q.modes[static_cast<std::size_t>(number)].n, extent(E, 2)}),
                "a source does not fit");
        q.sources.push_back({number, extent(E, 2), E.data()});
    }
    for (const auto &[number, shown, D, more] : noises) {
        require(within(number, q.sources.size()), "a signal does not fit");
        const Int own = q.modes[static_cast<std::size_t>(q.sources[static_cast<std::size_t>(number)].modes)].n;
        const Int p = extent(shown, 1);
        require(shaped(shown, {points, p, own}) && shaped(D, {points, p, m}) && shaped(more, {points}),
                "a signal does not fit");
        q.noises.push_back({number, p, shown.data(), D.data(), more.data()});
    }
    for (const auto &[L0, L1, M0, M1] : sides) {
        const Int p = extent(L0, 0);
        require(p == 1 || p == 2, "a side has one row or two");
        require(shaped(L0, {p, p}) && shaped(L1, {p, p}) && shaped(M0, {p, p}) && shaped(M1, {p, p}),
                "a side does not fit");
        q.sides.push_back({p, L0.data(), L1.data(), M0.data(), M1.data()});
    }
    require(extent(curves, 1) == 11, "a curve does not fit");
    for (Int k = 0; k < extent(curves, 0); ++k) {
        const double *own = curves.data() + 11 * k;
        require(own[0] >= 0 && own[0] < static_cast<double>(q.sides.size()), "a curve does not fit");
        q.curves.push_back({static_cast<Int>(own[0]), {own[1], own[2], own[3]},
                            {Complex(own[4], own[5]), Complex(own[6], own[7])}, own[8], own[9], own[10]});
    }
    const Int count = extent(measures, 0);
    require(shaped(measures, {count, 4}) && shaped(bends, {count, 2}), "measures do not fit");
    for (Int k = 0; k < count; ++k) {
        const Int *own = measures.data() + 4 * k;
        require(own[0] >= of_side && own[0] <= of_curve && own[3] >= kept && own[3] <= at_most &&
                    (own[0] != of_side || within(own[1], q.sides.size())) &&
                    (own[0] != of_curve || within(own[1], q.curves.size())) &&
                    (own[0] != of_noise || within(own[1], q.noises.size())),
                "no such measure");
        q.measures.push_back({static_cast<Kind>(own[0]), own[1], own[2], static_cast<Bend>(own[3]),
                              bends.data()[2 * k], bends.data()[2 * k + 1]});
    }
    Laws own(q);
    {
        nb::gil_scoped_release release;
        own.go();
    }
    const auto all = own.values.size();
    return nb::make_tuple(
        given(std::move(own.values), {all}),
        given(std::move(own.slopes), {all, static_cast<std::size_t>(own.width())}),
        given(std::move(own.groups), {all}), given(std::move(own.objective), {all}),
        given(std::move(own.ends), {static_cast<std::size_t>(laws)}),
        given(std::move(own.status), {static_cast<std::size_t>(laws)}),
        given(std::move(own.worst), {slopes ? 0 : static_cast<std::size_t>(count), static_cast<std::size_t>(points)}));
}

}  // namespace

void add_laws(nb::module_ &module) {
    module.def("rows", &rows, nb::arg("laws"), nb::arg("step"), nb::arg("fastest"),
               nb::arg("needs_decay"), nb::arg("first"), nb::arg("slopes"), nb::arg("K").noconvert(),
               nb::arg("C").noconvert(), nb::arg("term").noconvert(), nb::arg("pattern").noconvert(),
               nb::arg("largest").noconvert(), nb::arg("weight").noconvert(),
               nb::arg("unit").noconvert(), nb::arg("most").noconvert(), nb::arg("modes"),
               nb::arg("sources"), nb::arg("noises"), nb::arg("sides"),
               nb::arg("curves").noconvert(), nb::arg("measures").noconvert(), nb::arg("bends").noconvert());
}
