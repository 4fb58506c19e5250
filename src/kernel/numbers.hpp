// Numbers as they come to the exact provers: doubles, and a plant's rationals, as whole numbers.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <tuple>
#include <vector>

#include "whole.hpp"

namespace polefence {

namespace nb = nanobind;
using Doubles = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Powers = nb::ndarray<const Int, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Counts = nb::ndarray<const Int, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using FormArrays = std::tuple<Powers, Counts, Doubles>;             // exponents, multinomials, values
using PlantArrays = std::tuple<Powers, nb::bytes, nb::bytes, Int, Int>;  // exponents, [A, B], den; n, words

inline void require(bool fine, const char *message) {
    if (!fine) throw nb::value_error(message);
}

inline Int length_of(Int value) {  // bits of a count: a sum of so many needs so many more
    Int length = 0;
    while (value > 1) {
        value = (value + 1) / 2;
        ++length;
    }
    return length;
}

// A double: a whole number times a power of two.
struct Double {
    Int mantissa, exponent;  // odd or zero

    explicit Double(double value) : mantissa(0), exponent(0) {
        if (value == 0.0) return;
        int power = 0;
        mantissa = static_cast<Int>(std::ldexp(std::frexp(value, &power), 53));
        exponent = power - 53;
        const int zeros = __builtin_ctzll(static_cast<Word>(mantissa));
        mantissa >>= zeros;
        exponent += zeros;
    }
    Int length() const {
        return mantissa ? 64 - __builtin_clzll(static_cast<Word>(mantissa < 0 ? -mantissa : mantissa)) : 0;
    }
    Int bits(Int least) const { return mantissa ? length() + exponent - least : 0; }
    template <int K>
    Whole<K> over(Int least) const {
        return mantissa ? Whole<K>(mantissa) << (exponent - least) : Whole<K>();
    }
};

// Numbers that share the power of two `least`.
struct Group {
    std::vector<Double> numbers;
    Int least = 0;
    bool any = false;

    void take(const double *values, std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            require(std::isfinite(values[i]), "a number is not finite");
            numbers.emplace_back(values[i]);
            if (numbers.back().mantissa) include(numbers.back().exponent);
        }
    }
    void include(Int exponent) {
        least = any ? std::min(least, exponent) : exponent;
        any = true;
    }
    Int bits() const {
        Int most = 0;
        for (const Double &number : numbers) most = std::max(most, number.bits(least));
        return most;
    }
};

// Row k of exponents, a character each.
template <typename Exponents>
std::string exponent(const Exponents &exponents, std::size_t k) {
    std::string own;
    for (std::size_t j = 0; j < exponents.shape(1); ++j) {
        const Int power = exponents.data()[k * exponents.shape(1) + j];
        require(power >= 0 && power <= 16, "an exponent is 0 to 16");
        own.push_back(static_cast<char>(power));
    }
    return own;
}

// Coefficients of a polynomial: exponents and multinomials, and matrices of doubles.
struct Form {
    std::vector<std::string> powers;
    std::vector<Int> multinomials;
    std::size_t rows, columns;
    Group group;

    explicit Form(const FormArrays &given, std::size_t coordinates)
        : rows(std::get<2>(given).shape(1)), columns(std::get<2>(given).shape(2)) {
        const auto &[exponents, counts, values] = given;
        const std::size_t count = values.shape(0);
        require(count > 0 && rows > 0 && columns > 0, "a polynomial is empty");
        require(exponents.shape(0) == count && counts.shape(0) == count &&
                    exponents.shape(1) == coordinates,
                "exponents do not fit");
        for (std::size_t k = 0; k < count; ++k) {
            powers.push_back(exponent(exponents, k));
            const Int multinomial = counts.data()[k];
            require(multinomial > 0 && multinomial < (Int{1} << 50), "a multinomial is positive");
            multinomials.push_back(multinomial);
        }
        group.take(values.data(), count * rows * columns);
    }
    Int bits() const {
        return group.bits() + length_of(*std::max_element(multinomials.begin(), multinomials.end()));
    }
    std::size_t count() const { return powers.size(); }
};

// Numbers of a plant: [A, B] of each vertex times their denominator, in words.
struct Plant {
    std::vector<std::string> powers;
    std::size_t n, columns, words;
    std::string data, denominator;

    Plant(const PlantArrays &given, std::size_t coordinates) {
        const auto &[exponents, entries, whole, states, length] = given;
        require(states > 0 && length > 0, "a plant has states, and numbers have words");
        n = static_cast<std::size_t>(states);
        words = static_cast<std::size_t>(length);
        data.assign(entries.c_str(), entries.size());
        denominator.assign(whole.c_str(), whole.size());
        const std::size_t count = exponents.shape(0);
        require(count > 0 && exponents.shape(1) == coordinates, "exponents do not fit");
        require(denominator.size() == 8 * words, "the denominator does not fit");
        columns = data.size() / (8 * words * n * count);
        require(columns > n && data.size() == 8 * words * n * count * columns, "A and B do not fit");
        for (std::size_t k = 0; k < count; ++k) {
            powers.push_back(exponent(exponents, k));
        }
    }
    // Length of the longest number.
    Int bits() const {
        Int most = 0;
        for (const auto *from : {&data, &denominator})
            for (std::size_t k = 0; k < from->size() / (8 * words); ++k) {
                const auto byte = [&](std::size_t b) {
                    return static_cast<unsigned char>((*from)[8 * words * k + b]);
                };
                std::size_t length = 8 * words;
                const unsigned char fill = byte(length - 1) & 0x80 ? 0xff : 0;
                while (length > 0 && byte(length - 1) == fill) --length;
                most = std::max(most, 8 * static_cast<Int>(length));
            }
        return most;
    }
    template <int K>
    Whole<K> number(const std::string &from, std::size_t k) const {
        Whole<K> value;
        for (std::size_t i = 0; i < K; ++i) {
            Word word = 0;
            const std::size_t last = std::min(i, words - 1);
            for (int b = 7; b >= 0; --b)
                word = word << 8 | static_cast<unsigned char>(from[8 * (k * words + last) + b]);
            value.w[i] = i < words ? word : (word >> 63 ? ~Word{0} : 0);
        }
        return value;
    }
};

// What a claim decides, in as many words as its numbers need.
template <typename Claim>
int in_words(const Claim &claim, int unknown) {
    const Int bits = claim.bits();
    nb::gil_scoped_release release;
    if (bits <= 64 * 3) return static_cast<int>(claim.template decide<3>());
    if (bits <= 64 * 5) return static_cast<int>(claim.template decide<5>());
    if (bits <= 64 * 10) return static_cast<int>(claim.template decide<10>());
    if (bits <= 64 * 24) return static_cast<int>(claim.template decide<24>());
    return unknown;
}

}  // namespace polefence
