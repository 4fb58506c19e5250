// Peaks of singular values over the frequency: the twin of `_climbed` of response/peaks.py.
// Compiled once, for any processor.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <utility>
#include <vector>


namespace nb = nanobind;

namespace {

using Int = std::int64_t;
using Complex = std::complex<double>;
constexpr int looked_at = 5, rounds = 7, most_sweeps = 30;

template <int D>
using In = nb::ndarray<const double, nb::ndim<D>, nb::c_contig, nb::device::cpu>;
template <int D>
using InComplex = nb::ndarray<const Complex, nb::ndim<D>, nb::c_contig, nb::device::cpu>;

// Without the checks of a general product for what is not finite.
Complex times(Complex a, Complex b) {
    return {a.real() * b.real() - a.imag() * b.imag(), a.real() * b.imag() + a.imag() * b.real()};
}

double square(Complex a) { return a.real() * a.real() + a.imag() * a.imag(); }

// G(jw) = sum of left[:, k] right[k] / (jw - poles[k]) + F, (p x q), of one loop.
struct Loop {
    Int n, p, q;
    const Complex *poles, *left, *right;
    const double *F;
};

class Heights {
  public:
    Heights(Int n, Int p, Int q)
        : share(static_cast<std::size_t>(n)), G(static_cast<std::size_t>(p * q)),
          H(static_cast<std::size_t>(std::min(p, q) * std::min(p, q))) {}

    // The largest singular value at a frequency.
    double at(const Loop &loop, double w) {
        const Int n = loop.n, p = loop.p, q = loop.q;
        for (Int k = 0; k < n; ++k) {
            const double re = -loop.poles[k].real(), im = w - loop.poles[k].imag();
            const double size = re * re + im * im;
            share[k] = {re / size, -im / size};
        }
        for (Int i = 0; i < p; ++i) {
            Complex *row = G.data() + i * q;
            for (Int j = 0; j < q; ++j) row[j] = loop.F[i * q + j];
            for (Int k = 0; k < n; ++k) {
                const Complex own = times(loop.left[i * n + k], share[k]);
                for (Int j = 0; j < q; ++j) row[j] += times(own, loop.right[k * q + j]);
            }
        }
        if (p == 1 || q == 1) {
            double sum = 0;
            for (Int i = 0; i < p * q; ++i) sum += square(G[i]);
            return std::sqrt(sum);
        }
        return std::sqrt(std::max(0.0, p <= q ? gram(p, q, q, 1) : gram(q, p, 1, q)));
    }

  private:
    // The largest eigenvalue of M M', M the m x c matrix with these strides in G.
    double gram(Int m, Int c, Int down, Int across) {
        for (Int i = 0; i < m; ++i)
            for (Int j = 0; j < m; ++j) {
                Complex sum = 0;
                for (Int k = 0; k < c; ++k)
                    sum += times(G[i * down + k * across], std::conj(G[j * down + k * across]));
                H[i * m + j] = sum;
            }
        double trace = 0;
        for (Int i = 0; i < m; ++i) trace += H[i * m + i].real();
        for (int sweep = 0; sweep < most_sweeps; ++sweep) {
            double beside = 0;
            for (Int i = 0; i < m; ++i)
                for (Int j = i + 1; j < m; ++j) {
                    beside = std::max(beside, square(H[i * m + j]));
                    rotate(m, i, j);
                }
            if (!(beside > 1e-26 * trace * trace)) break;
        }
        double largest = 0;
        for (Int i = 0; i < m; ++i) largest = std::max(largest, H[i * m + i].real());
        return largest;
    }

    // One rotation of Jacobi's, after which entry (i, j) is zero.
    void rotate(Int m, Int i, Int j) {
        const Complex b = H[i * m + j];
        const double size = std::abs(b);
        if (!(size > 0)) return;
        const double tau = (H[j * m + j].real() - H[i * m + i].real()) / (2 * size);
        const double t = (tau >= 0 ? 1.0 : -1.0) / (std::abs(tau) + std::sqrt(1 + tau * tau));
        const double c = 1 / std::sqrt(1 + t * t);
        const Complex s = t * c * b / size;  // column j of the rotation is (s, c), column i (c, -s')
        for (Int k = 0; k < m; ++k) {
            const Complex x = H[k * m + i], y = H[k * m + j];
            H[k * m + i] = c * x - times(std::conj(s), y);
            H[k * m + j] = times(s, x) + c * y;
        }
        for (Int k = 0; k < m; ++k) {
            const Complex x = H[i * m + k], y = H[j * m + k];
            H[i * m + k] = c * x - times(s, y);
            H[j * m + k] = times(std::conj(s), x) + c * y;
        }
    }

    std::vector<Complex> share, G, H;
};

struct Found {
    std::vector<Int> loops;
    std::vector<double> w, top;
};

// The highest of the local peaks of one loop on a grid, each zoomed into.
void climb(const Loop &loop, Int number, const double *grid, Int count, Int points, Heights &heights,
           Found &found) {
    std::vector<double> values(static_cast<std::size_t>(count));
    for (Int j = 0; j < count; ++j) values[j] = heights.at(loop, grid[j]);
    const double most = *std::max_element(values.begin(), values.end());
    std::vector<Int> local;
    for (Int j = 0; j < count; ++j) {
        const double before = j > 0 ? values[j - 1] : -1.0, after = j + 1 < count ? values[j + 1] : -1.0;
        if (values[j] >= before && values[j] > after && values[j] >= 0.5 * most) local.push_back(j);
    }
    std::stable_sort(local.begin(), local.end(), [&](Int a, Int b) { return values[a] > values[b]; });
    if (local.size() > looked_at) local.resize(looked_at);
    std::vector<std::pair<double, double>> near(static_cast<std::size_t>(points + 1));
    for (const Int j : local) {
        double low = grid[std::max<Int>(j - 1, 0)], high = grid[std::min(j + 1, count - 1)];
        double best = grid[j], top = values[j];
        for (int round = 0; round < rounds; ++round) {
            for (Int k = 0; k < points; ++k) {
                const double w = low + (high - low) * (static_cast<double>(k) / static_cast<double>(points - 1));
                near[k] = {w, heights.at(loop, w)};
            }
            near[points] = {best, top};
            std::sort(near.begin(), near.end());
            Int k = 0;
            for (Int other = 1; other <= points; ++other)
                if (near[other].second > near[k].second) k = other;
            best = near[k].first, top = near[k].second;
            low = near[std::max<Int>(k - 1, 0)].first, high = near[std::min(k + 1, points)].first;
        }
        found.loops.push_back(number);
        found.w.push_back(best);
        found.top.push_back(top);
    }
}

template <class T>
nb::ndarray<nb::numpy, T> given(std::vector<T> own) {
    auto *kept = new std::vector<T>(std::move(own));
    const std::size_t shape[1] = {kept->size()};
    nb::capsule owner(kept, [](void *data) noexcept { delete static_cast<std::vector<T> *>(data); });
    return nb::ndarray<nb::numpy, T>(kept->data(), 1, shape, owner);
}

nb::tuple climbed(const InComplex<2> &poles, const InComplex<3> &left, const InComplex<3> &right,
                  const In<3> &F, const In<2> &grid, Int points) {
    const auto count = poles.shape(0), n = poles.shape(1), p = left.shape(1), q = right.shape(2);
    const auto f = grid.shape(1);
    if (left.shape(0) != count || left.shape(2) != n || right.shape(0) != count || right.shape(1) != n ||
        F.shape(0) != count || F.shape(1) != p || F.shape(2) != q || grid.shape(0) != count || f < 1 ||
        p < 1 || q < 1 || points < 2)
        throw nb::value_error("loops do not fit");
    Found found;
    {
        nb::gil_scoped_release release;
        Heights heights(static_cast<Int>(n), static_cast<Int>(p), static_cast<Int>(q));
        for (std::size_t k = 0; k < count; ++k) {
            const Loop loop{static_cast<Int>(n), static_cast<Int>(p), static_cast<Int>(q),
                            poles.data() + k * n, left.data() + k * p * n, right.data() + k * n * q,
                            F.data() + k * p * q};
            climb(loop, static_cast<Int>(k), grid.data() + k * f, static_cast<Int>(f), points, heights, found);
        }
    }
    return nb::make_tuple(given(std::move(found.loops)), given(std::move(found.w)), given(std::move(found.top)));
}

}  // namespace

void add_peaks(nb::module_ &module) {
    module.def("climbed", &climbed, nb::arg("poles").noconvert(), nb::arg("left").noconvert(),
               nb::arg("right").noconvert(), nb::arg("F").noconvert(), nb::arg("grid").noconvert(),
               nb::arg("points"));
}
