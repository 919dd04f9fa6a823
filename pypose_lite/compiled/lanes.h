// Numbers of several plans side by side: a `vec` has one for each, and all arithmetic is done for
// them at once. Where MANY is 0 there is one plan, and a vec is a plain number.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <thread>
#include <vector>

#if DOUBLE
typedef double real;
#else
typedef float real;
#endif

#if !MANY
constexpr int lanes = 1;
typedef real vec;
typedef bool mask;
static inline bool any(mask a) { return a; }
#else
#if defined(__AVX512F__)
constexpr int lanes = 64 / sizeof(real);
#elif defined(__AVX__)
constexpr int lanes = 32 / sizeof(real);
#else
constexpr int lanes = 16 / sizeof(real);
#endif
typedef real vec __attribute__((vector_size(lanes * sizeof(real))));
typedef decltype(vec{} < vec{}) mask;
static inline bool any(mask a) {
  bool found = false;
  for (int i = 0; i < lanes; i++) found |= a[i] != 0;
  return found;
}
#endif

static inline vec splat(real a) { return a - vec{}; }  // not a + 0, which loses the sign of -0
static inline mask none() { return splat(0) != splat(0); }
static inline vec where(mask c, vec a, vec b) { return c ? a : b; }
static inline mask is_finite(vec a) { return a - a == splat(0); }
static inline real &lane(vec &a, int i) { return reinterpret_cast<real *>(&a)[i]; }
static inline real lane(const vec &a, int i) { return reinterpret_cast<const real *>(&a)[i]; }

static inline vec v_abs(vec a) { return where(a < splat(0), -a, a); }
static inline vec v_maximum(vec a, vec b) { return where((a > b) | (a != a), a, b); }
static inline vec v_minimum(vec a, vec b) { return where((a < b) | (a != a), a, b); }
static inline vec v_sign(vec a) {
  return where(a > splat(0), splat(1), where(a < splat(0), splat(-1), a));
}

// Functions are those of the C library, lane by lane, or all lanes at once where it has them.
#define LANE_BY_LANE(name)                                              \
  static inline vec v_##name(vec a) {                                   \
    vec y;                                                              \
    for (int i = 0; i < lanes; i++) lane(y, i) = std::name(lane(a, i)); \
    return y;                                                           \
  }
#define LANE_BY_LANE_OF_TWO(name)                                                    \
  static inline vec v_##name(vec a, vec b) {                                         \
    vec y;                                                                           \
    for (int i = 0; i < lanes; i++) lane(y, i) = std::name(lane(a, i), lane(b, i));  \
    return y;                                                                        \
  }
LANE_BY_LANE(sqrt)
LANE_BY_LANE(floor)
LANE_BY_LANE(ceil)
LANE_BY_LANE(trunc)
static inline vec v_round(vec a) {
  vec y;
  for (int i = 0; i < lanes; i++) lane(y, i) = std::nearbyint(lane(a, i));  // halves to even
  return y;
}
static inline vec v_remainder(vec a, vec b) { return a - b * v_floor(a / b); }

#if MANY && defined(__x86_64__) && defined(__GLIBC__) && defined(__AVX2__)
#if __GLIBC__ > 2 || __GLIBC_MINOR__ >= 35
#define ALL_LANES 1
#endif
#endif

#if ALL_LANES
#if defined(__AVX512F__) && DOUBLE
#define NAME_OF(v, name) _ZGVeN8##v##_##name
#elif defined(__AVX512F__)
#define NAME_OF(v, name) _ZGVeN16##v##_##name##f
#elif DOUBLE
#define NAME_OF(v, name) _ZGVdN4##v##_##name
#else
#define NAME_OF(v, name) _ZGVdN8##v##_##name##f
#endif
#define FUNCTION(name)                      \
  extern "C" vec NAME_OF(v, name)(vec);     \
  static inline vec v_##name(vec a) { return NAME_OF(v, name)(a); }
#define FUNCTION_OF_TWO(name)                    \
  extern "C" vec NAME_OF(vv, name)(vec, vec);    \
  static inline vec v_##name(vec a, vec b) { return NAME_OF(vv, name)(a, b); }
#else
#define FUNCTION LANE_BY_LANE
#define FUNCTION_OF_TWO LANE_BY_LANE_OF_TWO
#endif
FUNCTION(sin)
FUNCTION(cos)
FUNCTION(tan)
FUNCTION(asin)
FUNCTION(acos)
FUNCTION(atan)
FUNCTION(sinh)
FUNCTION(cosh)
FUNCTION(tanh)
FUNCTION(exp)
FUNCTION(expm1)
FUNCTION(log)
FUNCTION(log1p)
FUNCTION(erf)
FUNCTION_OF_TWO(atan2)
FUNCTION_OF_TWO(pow)
