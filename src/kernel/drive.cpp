// Steps of Runge-Kutta for many cars at once: polefence/vehicle/driving/integration.py, compiled.
// Eight cars go side by side, the same numbers of each next to one another.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <vector>

#include "kernel.hpp"

namespace nb = nanobind;

namespace {

using Int = std::int64_t;
constexpr Int L = 8;  // cars side by side
constexpr double lost_beyond = 1e9, none = std::numeric_limits<double>::quiet_NaN();

template <int D>
using In = nb::ndarray<const double, nb::ndim<D>, nb::c_contig, nb::device::cpu>;
template <int D>
using Out = nb::ndarray<double, nb::ndim<D>, nb::c_contig, nb::device::cpu>;

void require(bool fine, const char *message) {
    if (!fine) throw nb::value_error(message);
}

// Of a damper's curves, from a rate on: their slopes, and where these lines are at zero.
struct Part {
    double start, low, low_start, high, high_start;
};

// Inputs of controllable dampers: u is between two curves of v = rate x.
struct Damper {
    Int number;
    const double *rate;
    std::vector<Part> parts;

    const Part &at(double v) const {
        auto own = parts.size() - 1;
        while (own && v < parts[own].start) --own;
        return parts[own];
    }
};

enum Mode : Int { by_gain, held, sampled };  // what is demanded: K x, or what was set before

struct Stretch {
    Int count, n, m, q, N, driven, width, steps, first, total, every;
    Int late, change;  // demands on their way; the step of a period in which the next one acts,
    double share;      // and after which share of it
    double h;
    const double *A, *B, *E, *S, *alpha, *noise, *K;
    bool moves, K_moves;
    Mode mode;
    double lag, limit;
    bool slews;              // inputs may move so fast only:
    const double *reach;     // how far they may be from what they follow,
    std::vector<Int> followed;  // which of z that is, none what was sent a sample before
    Int own;  // states of a law with anti-windup, whose rates are the inputs behind those driven
    const double *anti_windup;
    std::vector<Damper> dampers;
    Int stops;  // suspensions that have them
    double bump, rebound, stiffness, damping;
    const double *compression;
    double gravity;
    Int heavy;
    const double *per_mass, *first_load;
    double *z, *after, *underway, *states, *rates, *demanded, *applied, *pushes;

    bool breaks(Int instant) const { return share > 0 && instant % every == change; }
};

// Up to eight cars that go through a stretch of steps.
class Cars {
  public:
    Cars(const Stretch &stretch, Int begin)
        : s(stretch), begin(begin), many(std::min(L, s.count - begin)), A(s.n * s.n * L),
          B(s.n * s.m * L), E(s.n * s.q * L), S(s.n * s.stops * L), g(s.n * L), K(s.m * s.n * L),
          x(s.width * L), at(s.width * L), slopes(4 * s.width * L), asked(s.m * L), given(s.m * L),
          set(s.m * L), underway((1 + s.late) * s.m * L), push(s.stops * L), per_mass(L),
          gone(L, false) {
        for (Int l = 0; l < L; ++l)
            for (Int i = 0; i < s.width; ++i) x[i * L + l] = s.z[car(l) * s.width + i];
        for (Int l = 0; l < L; ++l)
            for (Int i = 0; i < (1 + s.late) * s.m; ++i)
                underway[i * L + l] = s.underway[car(l) * (1 + s.late) * s.m + i];
        look();
    }

    void go() {
        double *a = slopes.data();
        Int row = 0;
        for (Int k = 0; k < s.steps; ++k) {
            const bool breaks = s.breaks(s.first + k);
            equations(row);
            sample(k);
            slope(x.data(), a);
            record(s.first + k, a);
            advance(breaks ? s.share * s.h : s.h, row);
            row += 3;
            if (breaks) {
                equations(row);
                hold(s.late - 1);
                slope(x.data(), a);
                advance((1 - s.share) * s.h, row);
                row += 3;
            }
            look();
        }
        if (s.steps) {
            slope(x.data(), a);  // as it is before a controller looks at it
        } else {
            equations(0);
            sample(0);
            slope(x.data(), a);
            record(s.first, a);
        }
        for (Int l = 0; l < many; ++l) {
            for (Int i = 0; i < s.width; ++i) {
                s.z[car(l) * s.width + i] = x[i * L + l];
                s.after[car(l) * s.width + i] = a[i * L + l];
            }
            for (Int i = 0; i < (1 + s.late) * s.m; ++i)
                s.underway[car(l) * (1 + s.late) * s.m + i] = underway[i * L + l];
        }
    }

  private:
    using Numbers = std::vector<double>;
    const Stretch &s;
    Int begin, many;
    Numbers A, B, E, S, g, K, x, at, slopes, asked, given, set, underway, push, per_mass;
    std::vector<char> gone;
    bool known = false, K_known = false;

    Int car(Int l) const { return begin + std::min(l, many - 1); }

    // A step of Runge-Kutta, or a part of one: its slope at the begin is known.
    void advance(double h, Int row) {
        const Int size = s.width * L;
        double *a = slopes.data(), *b = a + size, *c = b + size, *d = c + size;
        for (Int i = 0; i < size; ++i) at[i] = x[i] + h / 2 * a[i];
        equations(row + 1);
        slope(at.data(), b);
        for (Int i = 0; i < size; ++i) at[i] = x[i] + h / 2 * b[i];
        slope(at.data(), c);
        for (Int i = 0; i < size; ++i) at[i] = x[i] + h * c[i];
        equations(row + 2);
        slope(at.data(), d);
        for (Int i = 0; i < size; ++i) x[i] += h / 6 * (a[i] + 2 * (b[i] + c[i]) + d[i]);
    }

    // M = sum of alpha_j M_j
    void mix(const double *vertices, Int size, Int row, Numbers &M) const {
        std::fill(M.begin(), M.end(), 0.0);
        for (Int j = 0; j < s.N; ++j) {
            double share[L];
            for (Int l = 0; l < L; ++l) share[l] = s.alpha[(row * s.count + car(l)) * s.N + j];
            for (Int i = 0; i < size; ++i)
                for (Int l = 0; l < L; ++l) M[i * L + l] += share[l] * vertices[j * size + i];
        }
    }

    // The plant, and all that acts on it besides the inputs, at a stage of a step.
    void equations(Int stage) {
        if (s.moves || !known) {
            const Int row = s.moves ? stage : 0;
            mix(s.A, s.n * s.n, row, A);
            mix(s.B, s.n * s.m, row, B);
            mix(s.E, s.n * s.q, row, E);
            mix(s.S, s.n * s.stops, row, S);
            if (s.gravity != 0.0) mix(s.per_mass, 1, row, per_mass);
            known = true;
        }
        if (s.mode == by_gain && (s.K_moves || !K_known)) gain(s.K_moves ? stage : 0);
        for (Int i = 0; i < s.n; ++i) {
            double sum[L] = {};
            for (Int j = 0; j < s.q; ++j)
                for (Int l = 0; l < L; ++l)
                    sum[l] += E[(i * s.q + j) * L + l] * s.noise[stage * s.q + j];
            for (Int l = 0; l < L; ++l) g[i * L + l] = sum[l];
        }
        if (s.gravity != 0.0)
            for (Int l = 0; l < L; ++l)
                g[s.heavy * L + l] -= s.gravity * (1 - s.first_load[car(l)] * per_mass[l]);
    }

    void gain(Int row) {
        for (Int i = 0; i < s.m * s.n; ++i)
            for (Int l = 0; l < L; ++l)
                K[i * L + l] = s.K[(row * s.count + car(l)) * s.m * s.n + i];
        K_known = true;
    }

    // u = K x
    void law(const double *y, double *u) const {
        for (Int j = 0; j < s.m; ++j) {
            double sum[L] = {};
            for (Int i = 0; i < s.n; ++i)
                for (Int l = 0; l < L; ++l) sum[l] += K[(j * s.n + i) * L + l] * y[i * L + l];
            for (Int l = 0; l < L; ++l) u[j * L + l] = sum[l];
        }
        hold_back(y, u);
    }

    // Input j of car l within the actuator's limits.
    double sent(Int j, Int l, double force, const double *y) const {
        if (std::isfinite(s.limit)) force = cut(force, -s.limit, s.limit);
        if (!s.slews) return force;
        const double middle = s.followed[j] < 0 ? underway[j * L + l] : y[s.followed[j] * L + l];
        return cut(force, middle - s.reach[j], middle + s.reach[j]);
    }

    // What is demanded beyond the limits moves the law's own states, by their rates.
    void hold_back(const double *y, double *u) const {
        if (!s.own || (!std::isfinite(s.limit) && !s.slews)) return;
        for (Int j = 0; j < s.driven; ++j)
            for (Int l = 0; l < L; ++l) {
                const double force = u[j * L + l], beyond = sent(j, l, force, y) - force;
                for (Int i = 0; i < s.own; ++i)
                    u[(s.driven + i) * L + l] += s.anti_windup[i * s.driven + j] * beyond;
            }
    }

    void rate(const Damper &own, const double *y, double *v) const {
        for (Int l = 0; l < L; ++l) v[l] = 0.0;
        for (Int i = 0; i < s.n; ++i)
            for (Int l = 0; l < L; ++l) v[l] += own.rate[i] * y[i * L + l];
    }

    // What acts of the demands; the rates of the law's own states act at once.
    void hold(Int late) {
        for (Int i = 0; i < s.m * L; ++i)
            set[i] = underway[i < s.driven * L ? late * s.m * L + i : i];
    }

    // A controller that samples demands anew, of a damper a coefficient; some demand is held.
    void sample(Int k) {
        if (s.mode == by_gain) return;
        const Int step = (s.first + k) % s.every;
        if (s.mode == sampled && !step) demand(k);
        hold(step > s.change || (step == s.change && !(s.share > 0)) ? s.late - 1 : s.late);
    }

    void demand(Int k) {
        if (s.K_moves || !K_known) {
            const Int before = (s.first + s.every - 1) / s.every;  // samples before this stretch
            gain(s.K_moves ? (s.first + k) / s.every - before : 0);
        }
        law(x.data(), asked.data());
        if (s.slews && s.followed[0] < 0)
            for (Int j = 0; j < s.driven; ++j)
                for (Int l = 0; l < L; ++l)
                    asked[j * L + l] = sent(j, l, asked[j * L + l], x.data());
        for (const auto &own : s.dampers) {
            double v[L], *u = asked.data() + own.number * L;
            rate(own, x.data(), v);
            for (Int l = 0; l < L; ++l) {
                const Part &part = own.at(v[l]);
                const double over = v[l] != 0.0 ? 1.0 / v[l] : 0.0;
                const double low = part.low + part.low_start * over;
                const double c = v[l] != 0.0 ? u[l] / v[l] : low;
                u[l] = cut(c, low, part.high + part.high_start * over);
            }
        }
        std::copy_backward(underway.begin(), underway.end() - s.m * L, underway.end());
        std::copy(asked.begin(), asked.end(), underway.begin());
    }

    // What is no number stays none.
    static double cut(double value, double low, double high) {
        const double above = value < low ? low : value;
        return above > high ? high : above;
    }

    void limited(const double *y, double *u) const {
        if (s.slews && s.followed[0] >= 0)
            for (Int j = 0; j < s.driven; ++j)
                for (Int l = 0; l < L; ++l) u[j * L + l] = sent(j, l, u[j * L + l], y);
        else if (std::isfinite(s.limit))
            for (Int i = 0; i < s.driven * L; ++i) u[i] = cut(u[i], -s.limit, s.limit);
        for (const auto &own : s.dampers) {
            double v[L], *force = u + own.number * L;
            rate(own, y, v);
            for (Int l = 0; l < L; ++l) {
                const Part &part = own.at(v[l]);
                const double one = part.low * v[l] + part.low_start;
                const double other = part.high * v[l] + part.high_start;
                force[l] = cut(force[l], std::min(one, other), std::max(one, other));
            }
        }
    }

    // dz = z' at y; asked, given and push are what the law demands, what acts, and the stops' force
    void slope(const double *y, double *dz) {
        const Int n = s.n, m = s.m, d = s.driven;
        if (s.mode == by_gain) {
            law(y, asked.data());
        } else {
            std::copy(set.begin(), set.end(), asked.begin());
            for (const auto &own : s.dampers) {
                double v[L];
                rate(own, y, v);
                for (Int l = 0; l < L; ++l) asked[own.number * L + l] *= v[l];
            }
        }
        std::copy(asked.begin(), asked.end(), given.begin());
        limited(y, given.data());
        if (s.lag > 0)
            for (Int i = 0; i < d * L; ++i) {
                dz[n * L + i] = s.lag * (given[i] - y[n * L + i]);
                given[i] = y[n * L + i];
            }
        for (Int i = 0; i < n; ++i) {
            double sum[L];
            for (Int l = 0; l < L; ++l) sum[l] = g[i * L + l];
            for (Int j = 0; j < n; ++j)
                for (Int l = 0; l < L; ++l) sum[l] += A[(i * n + j) * L + l] * y[j * L + l];
            for (Int j = 0; j < m; ++j)
                for (Int l = 0; l < L; ++l) sum[l] += B[(i * m + j) * L + l] * given[j * L + l];
            for (Int l = 0; l < L; ++l) dz[i * L + l] = sum[l];
        }
        for (Int j = 0; j < s.stops; ++j) stop(j, y, dz);
        for (Int i = 0; i < n; ++i)
            for (Int j = 0; j < s.stops; ++j)
                for (Int l = 0; l < L; ++l)
                    dz[i * L + l] += S[(i * s.stops + j) * L + l] * push[j * L + l];
    }

    // What the stops of one suspension push.
    void stop(Int j, const double *y, const double *dz) {
        double deflection[L] = {}, speed[L] = {};
        for (Int i = 0; i < s.n; ++i) {
            const double share = s.compression[j * s.n + i];
            if (share == 0.0) continue;
            for (Int l = 0; l < L; ++l) {
                deflection[l] += share * y[i * L + l];
                speed[l] += share * dz[i * L + l];
            }
        }
        for (Int l = 0; l < L; ++l) {
            const double over = deflection[l] - s.bump, under = -deflection[l] - s.rebound;
            const double up = std::max(s.stiffness * over + s.damping * speed[l], 0.0),
                         down = std::max(s.stiffness * under - s.damping * speed[l], 0.0);
            push[j * L + l] = (over > 0 ? up : 0.0) - (under > 0 ? down : 0.0);
        }
    }

    // Put no numbers where a car is lost.
    void look() {
        for (Int l = 0; l < L; ++l) {
            for (Int i = 0; i < s.width; ++i)
                if (!(std::fabs(x[i * L + l]) < lost_beyond)) gone[l] = true;
            if (!gone[l]) continue;
            for (Int i = 0; i < s.width; ++i) x[i * L + l] = none;
        }
    }

    void record(Int instant, const double *dz) {
        if (s.lag > 0) limited(x.data(), given.data());
        for (Int l = 0; l < many; ++l) {
            const Int place = car(l) * s.total + instant;
            for (Int i = 0; i < s.width; ++i) s.states[place * s.width + i] = x[i * L + l];
            for (Int i = 0; i < s.n; ++i)
                s.rates[place * s.n + i] = gone[l] ? none : dz[i * L + l];
            for (Int j = 0; j < s.m; ++j) {
                s.demanded[place * s.m + j] = gone[l] ? none : asked[j * L + l];
                s.applied[place * s.m + j] = gone[l] ? none : given[j * L + l];
            }
            for (Int j = 0; j < s.stops; ++j)
                s.pushes[place * s.stops + j] = gone[l] ? 0.0 : push[j * L + l];
        }
    }
};

struct Shared {
    const Stretch &s;
    std::atomic<Int> next{0};
};

void take(void *of, Int) {
    auto &shared = *static_cast<Shared *>(of);
    for (Int begin; (begin = L * shared.next++) < shared.s.count;) Cars(shared.s, begin).go();
}

Int size(std::size_t own) { return static_cast<Int>(own); }

// Goes through the steps first, ..., first + steps - 1. `noise` has three rows of each, six where
// another demand acts within it. Without steps it has one row, and what is the case at the instant
// `first` is recorded.
void drive(const In<3> &A, const In<3> &B, const In<3> &E, const In<3> &S, const In<3> &alpha,
           const In<2> &noise, const In<4> &K, double h, Int first, Int steps, Int mode, Int every,
           Int change, double share, Int driven, double lag, double limit, const In<1> &reach,
           const In<1> &followed, const In<2> &anti_windup, const In<2> &dampers, const In<2> &damper_rates,
           const In<1> &stops, const In<2> &compression, double gravity, Int heavy,
           const In<1> &per_mass, const In<1> &first_load, const Out<2> &z,
           const Out<2> &after, const Out<3> &underway, const Out<3> &states, const Out<3> &rates,
           const Out<3> &demanded, const Out<3> &applied, const Out<3> &pushes,
           Int threads) {
    Stretch s{};
    s.N = size(A.shape(0)), s.n = size(A.shape(1)), s.m = size(B.shape(2)), s.q = size(E.shape(2));
    s.count = size(z.shape(0)), s.width = size(z.shape(1)), s.total = size(states.shape(1));
    s.steps = steps, s.first = first, s.driven = driven, s.every = every;
    s.change = change, s.share = share, s.late = size(underway.shape(1)) - 1;
    s.h = h, s.lag = lag, s.limit = limit, s.gravity = gravity, s.heavy = heavy;
    require(s.N > 0 && s.n > 0 && s.m > 0 && size(A.shape(2)) == s.n, "A does not fit");
    require(size(B.shape(0)) == s.N && size(B.shape(1)) == s.n, "B does not fit");
    require(size(E.shape(0)) == s.N && size(E.shape(1)) == s.n, "E does not fit");
    require(size(S.shape(0)) == s.N && size(S.shape(1)) == s.n, "S does not fit");
    require(driven >= 0 && driven <= s.m && s.width == s.n + (lag > 0 ? driven : 0), "z does not fit");
    s.slews = size(reach.shape(0)) > 0, s.reach = reach.data();
    require(size(reach.shape(0)) == size(followed.shape(0)) &&
                (!s.slews || size(reach.shape(0)) == driven),
            "the rate limits do not fit");
    for (Int j = 0; s.slews && j < driven; ++j) {
        s.followed.push_back(static_cast<Int>(followed.data()[j]));
        require(s.followed[j] < s.width && (s.followed[j] >= 0) == (s.followed[0] >= 0) &&
                    (s.followed[j] >= 0 || mode != by_gain),
                "an input follows nothing");
    }
    s.own = size(anti_windup.shape(0)), s.anti_windup = anti_windup.data();
    require(s.own <= s.m - driven && (!s.own || size(anti_windup.shape(1)) == driven),
            "the anti-windup does not fit");
    const Int rows = size(alpha.shape(0)), stages = size(noise.shape(0));
    require(first >= 0 && steps >= 0 && steps < s.total && first < s.total - steps,
            "the steps do not fit");
    require(every > 0 && s.late >= 0 && change >= 0 && change <= every && share >= 0 && share < 1 &&
                (change == every ? share == 0 : s.late > 0),
            "what is on its way does not fit");
    Int pieces = steps;
    for (Int k = first; k < first + steps; ++k) pieces += s.breaks(k);
    require(s.count > 0 && stages == (steps ? 3 * pieces : 1) && size(noise.shape(1)) == s.q,
            "the disturbance does not fit");
    require((rows == 1 || rows == stages) && size(alpha.shape(1)) == s.count &&
                size(alpha.shape(2)) == s.N,
            "alpha does not fit");
    require(mode >= by_gain && mode <= sampled, "there is no such law");
    s.mode = static_cast<Mode>(mode);
    Int wanted = stages;
    if (mode == sampled)  // samples at the instants of these steps
        wanted = (first + std::max<Int>(s.steps, 1) - 1) / every - (first + every - 1) / every + 1;
    const Int gains = size(K.shape(0));
    require((gains == 1 || gains >= wanted || mode == held) && size(K.shape(1)) == s.count &&
                size(K.shape(2)) == s.m && size(K.shape(3)) == s.n,
            "K does not fit");
    s.moves = rows > 1, s.K_moves = gains > 1;
    require(size(dampers.shape(1)) == 6 && size(damper_rates.shape(1)) == s.n,
            "the dampers do not fit");
    for (Int i = 0; i < size(dampers.shape(0)); ++i) {
        const double *own = dampers.data() + 6 * i;
        require(own[0] >= 0 && own[0] < static_cast<double>(s.m), "a damper is no input");
        const auto number = static_cast<Int>(own[0]);
        if (s.dampers.empty() || s.dampers.back().number != number) {
            require(size(s.dampers.size()) < size(damper_rates.shape(0)), "the dampers do not fit");
            const double *rate = damper_rates.data() + size(s.dampers.size()) * s.n;
            s.dampers.push_back({number, rate, {}});
        }
        s.dampers.back().parts.push_back({own[1], own[2], own[3], own[4], own[5]});
    }
    require(size(s.dampers.size()) == size(damper_rates.shape(0)), "the dampers do not fit");
    s.stops = size(S.shape(2));
    require(size(stops.shape(0)) == (s.stops ? 4 : 0) && size(compression.shape(0)) == s.stops &&
                size(compression.shape(1)) == s.n,
            "the stops do not fit");
    if (s.stops) {
        const double *own = stops.data();
        s.bump = own[0], s.rebound = own[1], s.stiffness = own[2], s.damping = own[3];
    }
    require(gravity == 0.0 || (heavy >= 0 && heavy < s.n && size(per_mass.shape(0)) == s.N &&
                               size(first_load.shape(0)) == s.count),
            "the load does not fit");
    require(size(after.shape(0)) == s.count && size(after.shape(1)) == s.width,
            "the slopes do not fit");
    require(size(underway.shape(0)) == s.count && size(underway.shape(2)) == s.m,
            "what is on its way does not fit");
    const auto fits = [&](const Out<3> &own, Int each) {
        return size(own.shape(0)) == s.count && size(own.shape(1)) == s.total &&
               size(own.shape(2)) == each;
    };
    require(fits(states, s.width) && fits(rates, s.n) && fits(demanded, s.m) && fits(applied, s.m) &&
                fits(pushes, s.stops),
            "the record does not fit");
    require(threads >= 1 && threads <= 256, "there are 1 to 256 threads");
    s.A = A.data(), s.B = B.data(), s.E = E.data(), s.S = S.data(), s.alpha = alpha.data();
    s.noise = noise.data(), s.K = K.data(), s.z = z.data(), s.compression = compression.data();
    s.per_mass = per_mass.data(), s.first_load = first_load.data();
    s.after = after.data();
    s.underway = underway.data(), s.states = states.data(), s.rates = rates.data(),
    s.demanded = demanded.data(), s.applied = applied.data();
    s.pushes = pushes.data();
    nb::gil_scoped_release release;
    Shared shared{s};
    polefence::in_threads(std::min(threads, (s.count + L - 1) / L), take, &shared);
}

}  // namespace

void add_drive(nb::module_ &module) {
    module.def("drive", &drive, nb::arg("A").noconvert(), nb::arg("B").noconvert(),
               nb::arg("E").noconvert(), nb::arg("S").noconvert(), nb::arg("alpha").noconvert(),
               nb::arg("noise").noconvert(), nb::arg("K").noconvert(), nb::arg("h"),
               nb::arg("first"), nb::arg("steps"), nb::arg("mode"), nb::arg("every"),
               nb::arg("change"), nb::arg("share"), nb::arg("driven"), nb::arg("lag"),
               nb::arg("limit"),
               nb::arg("reach").noconvert(), nb::arg("followed").noconvert(),
               nb::arg("anti_windup").noconvert(), nb::arg("dampers").noconvert(),
               nb::arg("damper_rates").noconvert(), nb::arg("stops").noconvert(),
               nb::arg("compression").noconvert(), nb::arg("gravity"), nb::arg("heavy"),
               nb::arg("per_mass").noconvert(), nb::arg("first_load").noconvert(),
               nb::arg("z").noconvert(), nb::arg("after").noconvert(),
               nb::arg("underway").noconvert(), nb::arg("states").noconvert(),
               nb::arg("rates").noconvert(), nb::arg("demanded").noconvert(),
               nb::arg("applied").noconvert(), nb::arg("pushes").noconvert(),
               nb::arg("threads") = 1);
}
