// Whole numbers of K words in two's complement, and matrices of them. Every operation is exact while
// the true value fits into K words, which callers bound beforehand; nothing here is rounded.
#pragma once
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace polefence {

using Word = std::uint64_t;
using Wide = unsigned __int128;
using Signed = __int128;
using Int = std::int64_t;

template <int K>
struct Whole {
    Word w[K] = {};

    Whole() = default;
    explicit Whole(Int value) {
        w[0] = static_cast<Word>(value);
        for (int i = 1; i < K; ++i) w[i] = value < 0 ? ~Word{0} : 0;
    }

    bool negative() const { return w[K - 1] >> 63; }
    bool zero() const {
        for (int i = 0; i < K; ++i)
            if (w[i]) return false;
        return true;
    }
    bool operator==(const Whole &other) const {
        for (int i = 0; i < K; ++i)
            if (w[i] != other.w[i]) return false;
        return true;
    }

    Whole &operator+=(const Whole &other) {
        Word carry = 0;
        for (int i = 0; i < K; ++i) {
            const Wide sum = static_cast<Wide>(w[i]) + other.w[i] + carry;
            w[i] = static_cast<Word>(sum);
            carry = static_cast<Word>(sum >> 64);
        }
        return *this;
    }
    Whole operator-() const {
        Whole result;
        Word carry = 1;
        for (int i = 0; i < K; ++i) {
            const Wide sum = static_cast<Wide>(~w[i]) + carry;
            result.w[i] = static_cast<Word>(sum);
            carry = static_cast<Word>(sum >> 64);
        }
        return result;
    }
    Whole &operator-=(const Whole &other) { return *this += -other; }

    // adds x y
    void add(const Whole &x, const Whole &y) {
        for (int i = 0; i < K; ++i) {
            if (!x.w[i]) continue;
            Word carry = 0;
            for (int j = 0; i + j < K; ++j) {
                const Wide sum = static_cast<Wide>(x.w[i]) * y.w[j] + w[i + j] + carry;
                w[i + j] = static_cast<Word>(sum);
                carry = static_cast<Word>(sum >> 64);
            }
        }
    }
    Whole operator*(const Whole &other) const {
        Whole result;
        result.add(*this, other);
        return result;
    }

    Whole operator<<(Int shift) const {
        Whole result;
        const Int words = shift / 64, bits = shift % 64;
        for (Int i = K - 1; i >= words; --i) {
            Word value = w[i - words] << bits;
            if (bits && i > words) value |= w[i - words - 1] >> (64 - bits);
            result.w[i] = value;
        }
        return result;
    }
    // rounds down
    Whole operator>>(Int shift) const {
        Whole result;
        const Word fill = negative() ? ~Word{0} : 0;
        const Int words = shift / 64, bits = shift % 64;
        for (Int i = 0; i < K; ++i) {
            const Word low = i + words < K ? w[i + words] : fill;
            const Word high = i + words + 1 < K ? w[i + words + 1] : fill;
            result.w[i] = bits ? low >> bits | high << (64 - bits) : low;
        }
        return result;
    }

    // length of the magnitude
    Int bits() const {
        const Whole size = negative() ? -*this : *this;
        for (int i = K - 1; i >= 0; --i)
            if (size.w[i]) return 64 * i + 64 - __builtin_clzll(size.w[i]);
        return 0;
    }
};

template <int K>
struct Matrix {
    std::size_t rows = 0, columns = 0;
    std::vector<Whole<K>> entries;

    Matrix() = default;
    Matrix(std::size_t rows, std::size_t columns)
        : rows(rows), columns(columns), entries(rows * columns) {}

    Whole<K> *operator[](std::size_t i) { return entries.data() + i * columns; }
    const Whole<K> *operator[](std::size_t i) const { return entries.data() + i * columns; }

    Matrix &operator+=(const Matrix &other) {
        for (std::size_t i = 0; i < entries.size(); ++i) entries[i] += other.entries[i];
        return *this;
    }
    // adds X Y
    void add(const Matrix &X, const Matrix &Y) {
        for (std::size_t i = 0; i < rows; ++i)
            for (std::size_t k = 0; k < X.columns; ++k) {
                const Whole<K> &x = X[i][k];
                if (x.zero()) continue;
                for (std::size_t j = 0; j < columns; ++j) (*this)[i][j].add(x, Y[k][j]);
            }
    }
    // adds X' Y
    void add_transposed(const Matrix &X, const Matrix &Y) {
        for (std::size_t k = 0; k < X.rows; ++k)
            for (std::size_t i = 0; i < rows; ++i)
                for (std::size_t j = 0; j < columns; ++j) (*this)[i][j].add(X[k][i], Y[k][j]);
    }
    void scale(const Whole<K> &factor) {
        for (auto &entry : entries) entry = factor * entry;
    }
    bool symmetric() const {
        for (std::size_t i = 0; i < rows; ++i)
            for (std::size_t j = 0; j < i; ++j)
                if (!((*this)[i][j] == (*this)[j][i])) return false;
        return true;
    }
};

enum class Sign { unknown = -1, not_positive = 0, positive = 1 };

// The root of a number below 2^126, rounded down.
inline Int root(Signed value) {
    auto x = static_cast<Int>(__builtin_sqrtl(static_cast<long double>(value)));
    while (static_cast<Signed>(x) * x > value) --x;
    while (static_cast<Signed>(x + 1) * (x + 1) <= value) ++x;
    return x;
}

constexpr int DIGITS = 62;  // of the numbers that decide whether a matrix is positive definite
constexpr Signed ONE = static_cast<Signed>(1) << DIGITS;

// Whether all pivots of Cholesky's recursion for s + c I are positive, s (n x n) by its upper half:
// `_has_root` of polefence/proof/matrices.py, loop for loop. A column whose squares exceed what is
// on its diagonal has a pivot that is none, so that no sum leaves 126 bits.
inline bool has_root(const std::vector<Int> &s, std::size_t n, Int c) {
    std::vector<Int> R(n * n);
    std::vector<Signed> rest(n);
    for (std::size_t i = 0; i < n; ++i) rest[i] = (static_cast<Signed>(s[i * n + i]) + c) * ONE;
    for (std::size_t i = 0; i < n; ++i) {
        const Int pivot = rest[i] > 0 ? root(rest[i]) : 0;
        if (!pivot) return false;
        for (std::size_t j = i + 1; j < n; ++j) {
            Signed value = static_cast<Signed>(s[i * n + j]) * ONE;
            for (std::size_t k = 0; k < i; ++k)
                value -= static_cast<Signed>(R[i * n + k]) * R[j * n + k];
            Signed quotient = value / pivot;
            if (value % pivot < 0) --quotient;
            if (quotient > 2 * ONE || quotient < -2 * ONE) return false;
            R[j * n + i] = static_cast<Int>(quotient);
            rest[j] -= quotient * quotient;
            if (rest[j] <= 0) return false;
        }
    }
    return true;
}

// Whether a symmetric matrix is positive definite: `_attempt` of polefence/proof/matrices.py, where
// the reasons stand, with 62 bits. What it says is exact; it may not know.
template <int K>
Sign positive_definite(const Matrix<K> &matrix) {
    const std::size_t n = matrix.rows;
    std::vector<Int> half(n), s(n * n);
    for (std::size_t i = 0; i < n; ++i) {
        const Whole<K> &diagonal = matrix[i][i];
        if (diagonal.negative() || diagonal.zero()) return Sign::not_positive;
        half[i] = (diagonal.bits() + 1) / 2;
    }
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = i; j < n; ++j) {
            const Whole<K> &entry = matrix[i][j];
            const Int total = half[i] + half[j], shift = DIGITS - total;
            if (entry.bits() > total) return Sign::not_positive;
            // what is shifted down fits one word; what is shifted up has few bits
            const Whole<K> cut = shift < 0 ? entry >> -shift : entry;
            s[i * n + j] = shift < 0 ? static_cast<Int>(cut.w[0])
                                     : static_cast<Int>(cut.w[0] << shift);
        }
    const Int c = 4 * static_cast<Int>(n) + 4;
    if (has_root(s, n, -c)) return Sign::positive;
    return has_root(s, n, c) ? Sign::unknown : Sign::not_positive;
}

}  // namespace polefence
