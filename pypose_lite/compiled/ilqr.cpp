// Iterative LQR as control/ does it: the same sweeps in the same letters and the same order, for as
// many plans at a time as a `vec` has lanes. A plan that is done gives its lane to the next.
//
// Above this stand n, m, COUNT (of numbers that a step takes) and the system's functions, of one
// step each, with z = [x, u] and k = n + m:
//
//   transition(kind, x, u, t, numbers, y)    y = f(x, u, t)
//   slopes(kind, x, u, t, numbers, F)        F = [A B] = df/dz, (n, k)
//   curvature(kind, x, u, t, numbers, l, S)  S = d2 (l' f) / dz2, (k, k)

constexpr int k = n + m;
constexpr real EPS = std::numeric_limits<real>::epsilon(), INF = INFINITY;
constexpr real NEAR = 0.03, EXPLODED = 100;                  // as in control/
constexpr real SHORTER[] = {real(0.5), real(0.2), real(0.05)};  // as in control/

extern "C" struct Sequence {  // numbers (T, B, size); a stride of 0 where times or members share
  const real *data;
  int64_t by_time, by_member;
};

extern "C" struct Problem {
  int64_t T, B;
  const int64_t *times;  // (T)
  const int64_t *kinds;  // (T), what each step does
  Sequence numbers, Q, p, r, Qf, pf, rf, lower, upper, du, x_init;
};

extern "C" struct Iterate {  // in and out: X (T+1, B, n), U (T, B, m), K (T, B, m, n), others (B)
  real *X, *U, *K, *cost, *promised, *size, *damping;
  uint8_t *exact, *converged;
  uint8_t *strange;  // out: the rollout diverges, or a derivative is not finite
  int64_t *iterations;
  real *history;  // out: (sweeps + 1, B)
};

// A sequence with one member in each lane; members that are not shared are copied.
struct Lanes {
  const Sequence from;
  const int64_t size, steps;
  const bool copied;
  std::vector<vec> own;

  Lanes(const Sequence &from, int64_t size, int64_t T, bool always = false)
      : from(from), size(size), steps(from.by_time ? T : 1), copied(always || from.by_member) {
    if (!copied) return;
    own.resize(steps * size);
    for (int i = 0; i < lanes; i++) load(i, 0);
  }
  void load(int i, int64_t member) {
    if (!copied) return;
    for (int64_t t = 0; t < steps; t++)
      for (int64_t j = 0; j < size; j++)
        lane(own[t * size + j], i) = from.data[t * from.by_time + member * from.by_member + j];
  }
  bool given() const { return from.data; }
  const vec *at(int64_t t) const { return own.data() + (from.by_time ? t * size : 0); }
  vec operator()(int64_t t, int64_t j) const {
    return copied ? at(t)[j] : splat(from.data[t * from.by_time + j]);
  }
};

struct Plan {  // X (T+1, n), U (T, m)
  std::vector<vec> X, U;
  vec cost = splat(0);
  explicit Plan(int64_t T) : X((T + 1) * n), U(T * m) {}
};

static void choose(mask these, const Plan &a, const Plan &b, Plan &to) {
  for (size_t i = 0; i < to.X.size(); i++) to.X[i] = where(these, a.X[i], b.X[i]);
  for (size_t i = 0; i < to.U.size(); i++) to.U[i] = where(these, a.U[i], b.U[i]);
  to.cost = where(these, a.cost, b.cost);
}

// [K, k] = -H^-1 [R, r] for H > 0, by Cholesky's factor L.
static mask free_gains(const vec (&H)[m][m], const vec (&R)[m][n + 1], vec (&K)[m][n + 1]) {
  vec L[m][m];
  mask failed = none();
  for (int j = 0; j < m; j++)
    for (int i = j; i < m; i++) {
      vec s = H[i][j];
      for (int a = 0; a < j; a++) s -= L[i][a] * L[j][a];
      if (i == j) {
        failed = failed | !(s > splat(0));
        s = v_sqrt(where(s > splat(0), s, splat(1)));
      } else {
        s /= L[j][j];
      }
      L[i][j] = s;
    }
  for (int b = 0; b <= n; b++) {
    vec w[m];
    for (int i = 0; i < m; i++) {
      w[i] = -R[i][b];
      for (int a = 0; a < i; a++) w[i] -= L[i][a] * w[a];
      w[i] /= L[i][i];
    }
    for (int i = m - 1; i >= 0; i--) {
      for (int a = i + 1; a < m; a++) w[i] -= L[a][i] * K[a][b];
      K[i][b] = w[i] / L[i][i];
    }
  }
  return failed;
}

// The gains of the inputs that are free while the clamped ones stay `at`.
static mask gains_beside(const mask (&clamped)[m], const vec (&at)[m], const vec (&Huu)[m][m],
                         const vec (&Hu)[m][n + 1], vec (&K)[m][n + 1]) {
  vec held[m][m], rest[m][n + 1];
  for (int i = 0; i < m; i++) {
    for (int j = 0; j < m; j++)
      held[i][j] = where(clamped[i] | clamped[j], splat(i == j), Huu[i][j]);
    for (int j = 0; j <= n; j++) rest[i][j] = Hu[i][j];
    for (int j = 0; j < m; j++) rest[i][n] += Huu[i][j] * at[j];
    for (int j = 0; j <= n; j++) rest[i][j] = where(clamped[i], splat(0), rest[i][j]);
  }
  const mask failed = free_gains(held, rest, K);
  for (int i = 0; i < m; i++) K[i][n] += at[i];
  return failed;
}

// [K, k] of the least 1/2 u' Huu u + u' (Hux x + hu), u between low and high where x = 0: first the
// inputs that stand at a bound and are pushed outward are clamped, then also those that the
// remaining freedom sends across one.
static mask gains_in_box(const vec (&low)[m], const vec (&high)[m], const vec (&Huu)[m][m],
                         const vec (&Hu)[m][n + 1], vec (&K)[m][n + 1]) {
  const vec zero = splat(0);
  mask clamped[m];
  vec at[m];
  for (int i = 0; i < m; i++) {
    const vec hu = Hu[i][n], up = v_maximum(low[i], zero), down = v_minimum(high[i], zero);
    clamped[i] = ((low[i] >= zero) & (hu >= zero)) | ((high[i] <= zero) & (hu <= zero));
    at[i] = where(clamped[i], up + down, zero);
  }
  const mask failed = gains_beside(clamped, at, Huu, Hu, K);
  for (int i = 0; i < m; i++) {
    const vec u = K[i][n];
    clamped[i] = clamped[i] | (u < low[i]) | (u > high[i]);
    at[i] = where(u < low[i], low[i], where(u > high[i], high[i], u));
    at[i] = where(clamped[i], at[i], zero);
  }
  return failed | gains_beside(clamped, at, Huu, Hu, K);
}

struct Optimizer {
  const Problem &problem;
  const int64_t T;
  Lanes numbers, Q, p, r, Qf, pf, rf, lower, upper, du, x_init;
  const bool bounded;
  Plan at, now, tried, best;
  std::vector<vec> K, gains;  // (T, m, n) of the plan, and (T, m, n+1) of a sweep
  vec promised = splat(0), size = splat(INF), damping = splat(0), exact = splat(0);
  vec change = splat(0);
  mask failed = none(), strange = none();

  explicit Optimizer(const Problem &of)
      : problem(of), T(of.T), numbers(of.numbers, COUNT, T, true), Q(of.Q, k * k, T), p(of.p, k, T),
        r(of.r, k, T), Qf(of.Qf, n * n, 1), pf(of.pf, n, 1), rf(of.rf, n, 1), lower(of.lower, m, T),
        upper(of.upper, m, T), du(of.du, m, T), x_init(of.x_init, n, 1),
        bounded(lower.given() || upper.given() || du.given()), at(T), now(T), tried(T), best(T),
        K(T * m * n), gains(T * m * (n + 1)) {}

  void load(int i, int64_t member) {
    for (Lanes *z : {&numbers, &Q, &p, &r, &Qf, &pf, &rf, &lower, &upper, &du, &x_init})
      z->load(i, member);
  }
  int kind(int64_t t) const { return static_cast<int>(problem.kinds[t]); }
  vec time(int64_t t) const { return splat(static_cast<real>(problem.times[t])); }

  // The least and the largest inputs that a sweep from u may choose.
  void bounds(int64_t t, const vec *u, vec (&low)[m], vec (&high)[m]) const {
    for (int i = 0; i < m; i++) {
      low[i] = lower.given() ? lower(t, i) : splat(-INF);
      high[i] = upper.given() ? upper(t, i) : splat(INF);
      if (du.given()) low[i] = v_maximum(low[i], u[i] - du(t, i));
      if (du.given()) high[i] = v_minimum(high[i], u[i] + du(t, i));
    }
  }

  // 1/2 (z - r)' Q (z - r) + p' z, and its slope q.
  vec cost(int64_t t, const vec *x, const vec *u, vec (&q)[k]) const {
    vec off[k], total = splat(0);
    for (int i = 0; i < k; i++) off[i] = (i < n ? x[i] : u[i - n]) - r(t, i);
    for (int i = 0; i < k; i++) {
      q[i] = splat(0);
      for (int j = 0; j < k; j++) q[i] += Q(t, i * k + j) * off[j];
      total += off[i] * q[i] / 2 + p(t, i) * (i < n ? x[i] : u[i - n]);
      q[i] += p(t, i);
    }
    return total;
  }

  vec last_cost(const vec *x, vec (&v)[n]) const {
    vec total = splat(0);
    for (int i = 0; i < n; i++) {
      v[i] = splat(0);
      for (int j = 0; j < n; j++) v[i] += Qf(0, i * n + j) * (x[j] - rf(0, j));
      total += (x[i] - rf(0, i)) * v[i] / 2 + pf(0, i) * x[i];
      v[i] += pf(0, i);
    }
    return total;
  }

  // A model along the plan, and Riccati from the end: gains [K, k] and the change they promise.
  // States need not follow from the inputs where there are defects.
  void model_and_riccati(bool defects) {
    vec V[n][n], v[n], c = splat(0), l[n], sum = splat(0);
    last_cost(&at.X[T * n], v);
    for (int i = 0; i < n; i++) {
      l[i] = v[i];
      for (int j = 0; j < n; j++) V[i][j] = Qf(0, i * n + j);
    }
    const bool newton = !defects && any(exact != splat(0));
    failed = none();
    for (int64_t t = T - 1; t >= 0; t--) {
      const vec *x = &at.X[t * n], *u = &at.U[t * m];
      vec F[n * k], H[k][k], q[k];
      slopes(kind(t), x, u, time(t), numbers.at(t), F);
      for (int i = 0; i < n * k; i++) sum += F[i];
      cost(t, x, u, q);
      for (int i = 0; i < k; i++)
        for (int j = 0; j <= i; j++) H[i][j] = Q(t, i * k + j);
      if (newton) {
        vec S[k * k];
        curvature(kind(t), x, u, time(t), numbers.at(t), l, S);
        for (int i = 0; i < k; i++)
          for (int j = 0; j <= i; j++) {
            H[i][j] += where(exact != splat(0), S[i * k + j], splat(0));
            sum += where(exact != splat(0), S[i * k + j], splat(0));
          }
        costate(q, F, &K[t * m * n], l);
      }
      if (!defects)
        for (int i = n; i < k; i++) H[i][i] += damping;
      if (defects) from_origin(t, V, v, c);
      failed = failed | riccati_step(t, F, H, q, V, v, c);
    }
    change = c;
    strange = !is_finite(sum);
  }

  // l_t = q_x + K' q_u + (A + B K)' l_t+1
  static void costate(const vec (&q)[k], const vec (&F)[n * k], const vec *K, vec (&l)[n]) {
    vec to_u[m], earlier[n];
    for (int i = 0; i < m; i++) {
      to_u[i] = q[n + i];
      for (int a = 0; a < n; a++) to_u[i] += F[a * k + n + i] * l[a];
    }
    for (int i = 0; i < n; i++) {
      earlier[i] = q[i];
      for (int a = 0; a < n; a++) earlier[i] += F[a * k + i] * l[a];
      for (int a = 0; a < m; a++) earlier[i] += K[a * n + i] * to_u[a];
    }
    std::copy(earlier, earlier + n, l);
  }

  // The cost-to-go as a function of x - d, with d = f(x, u) - x' of the plan.
  void from_origin(int64_t t, const vec (&V)[n][n], vec (&v)[n], vec &c) const {
    vec d[n], slope[n];
    transition(kind(t), &at.X[t * n], &at.U[t * m], time(t), numbers.at(t), d);
    for (int i = 0; i < n; i++) d[i] -= at.X[(t + 1) * n + i];
    for (int i = 0; i < n; i++) {
      slope[i] = splat(0);
      for (int j = 0; j < n; j++) slope[i] += V[i][j] * d[j];
    }
    for (int i = 0; i < n; i++) c += d[i] * (v[i] + slope[i] / 2);
    for (int i = 0; i < n; i++) v[i] += slope[i];
  }

  // H = Q + F' V F and h = q + F' v, their least in u, and what is left to pay one step earlier.
  mask riccati_step(int64_t t, const vec (&F)[n * k], vec (&H)[k][k], vec (&h)[k], vec (&V)[n][n],
                    vec (&v)[n], vec &c) {
    vec VF[n][k], Huu[m][m], Hu[m][n + 1], G[m][n + 1];
    for (int i = 0; i < n; i++)
      for (int j = 0; j < k; j++) {
        VF[i][j] = V[i][0] * F[j];
        for (int a = 1; a < n; a++) VF[i][j] += V[i][a] * F[a * k + j];
      }
    for (int i = 0; i < k; i++) {
      for (int a = 0; a < n; a++) h[i] += F[a * k + i] * v[a];
      for (int j = 0; j <= i; j++)
        for (int a = 0; a < n; a++) H[i][j] += F[a * k + i] * VF[a][j];
    }
    for (int i = 0; i < m; i++) {
      for (int j = 0; j < m; j++) Huu[i][j] = H[n + std::max(i, j)][n + std::min(i, j)];
      for (int j = 0; j < n; j++) Hu[i][j] = H[n + i][j];
      Hu[i][n] = h[n + i];
    }
    mask none_here;
    if (bounded) {
      vec low[m], high[m];
      bounds(t, &at.U[t * m], low, high);
      for (int i = 0; i < m; i++) low[i] -= at.U[t * m + i], high[i] -= at.U[t * m + i];
      none_here = gains_in_box(low, high, Huu, Hu, G);
    } else {
      none_here = free_gains(Huu, Hu, G);
    }
    for (int i = 0; i < m; i++) {
      vec slope = Hu[i][n];
      for (int a = 0; a < m; a++) slope += Huu[i][a] * G[a][n] / 2;
      c += G[i][n] * slope;
    }
    for (int i = 0; i < n; i++) {
      v[i] = h[i];
      for (int a = 0; a < m; a++) v[i] += Hu[a][i] * G[a][n];
      for (int j = 0; j <= i; j++) {
        vec s = splat(0);
        for (int a = 0; a < m; a++) s += Hu[a][i] * G[a][j] + Hu[a][j] * G[a][i];
        V[i][j] = V[j][i] = H[i][j] + s / 2;  // symmetric, at every step
      }
    }
    std::copy(&G[0][0], &G[0][0] + m * (n + 1), &gains[t * m * (n + 1)]);
    return none_here;
  }

  // u = U + length k + K (x - X), kept within the bounds, and the states that it leads to.
  void follow(real length, Plan &to) const {
    to.cost = splat(0);
    vec q[k], v[n];
    for (int i = 0; i < n; i++) to.X[i] = x_init(0, i);
    for (int64_t t = 0; t < T; t++) {
      const vec *x = &to.X[t * n], *row = &gains[t * m * (n + 1)];
      vec *u = &to.U[t * m];
      for (int i = 0; i < m; i++, row += n + 1) {
        u[i] = at.U[t * m + i] + length * row[n];
        for (int j = 0; j < n; j++) u[i] += row[j] * (x[j] - at.X[t * n + j]);
      }
      if (bounded) {
        vec low[m], high[m];
        bounds(t, &at.U[t * m], low, high);
        for (int i = 0; i < m; i++)
          u[i] = where(u[i] < low[i], low[i], where(u[i] > high[i], high[i], u[i]));
      }
      transition(kind(t), x, u, time(t), numbers.at(t), &to.X[(t + 1) * n]);
      to.cost += cost(t, x, u, q);
    }
    to.cost += last_cost(&to.X[T * n], v);
    to.cost = where(is_finite(to.cost), to.cost, splat(INF));
  }

  // Lanes that are new are rolled out, from their first inputs, or, where that explodes, by the
  // regulator around standing still.
  void start(mask fresh) {
    for (int64_t t = 0; t < T; t++)
      for (int i = 0; i < m; i++) {
        vec &u = at.U[t * m + i];
        if (lower.given()) u = where(fresh, v_maximum(u, lower(t, i)), u);
        if (upper.given()) u = where(fresh, v_minimum(u, upper(t, i)), u);
      }
    std::fill(gains.begin(), gains.end(), splat(0));
    follow(0, now);
    vec usual = splat(0), largest = splat(0);
    for (int i = 0; i < n; i++) {
      usual = v_maximum(usual, v_abs(x_init(0, i)));
      for (int64_t t = 0; t < r.steps; t++) usual = v_maximum(usual, v_abs(r(t, i)));
    }
    for (const vec &x : now.X) largest = v_maximum(largest, v_abs(x));
    const mask exploded = fresh & !(largest <= EXPLODED * usual);
    strange = none();
    choose(fresh, now, at, at);
    if (!any(exploded)) return;
    choose(splat(0) == splat(0), at, at, best);
    for (size_t i = 0; i < at.X.size(); i++) at.X[i] = where(exploded, x_init(0, i % n), at.X[i]);
    model_and_riccati(true);
    follow(1, now);
    choose(exploded & (now.cost < best.cost), now, best, at);
    strange = exploded & !is_finite(at.cost);
  }

  // One sweep of every lane, and the verdict on it; returns which plans have converged.
  mask improve() {
    model_and_riccati(false);
    change = where(failed, splat(0), change);
    vec step = splat(0), largest = splat(0), unit = splat(0);
    for (int64_t t = 0; t < T; t++)
      for (int i = 0; i < m; i++) {
        vec *row = &gains[(t * m + i) * (n + 1)];
        for (int j = 0; j < n; j++) row[j] = where(failed, K[(t * m + i) * n + j], row[j]);
        row[n] = where(failed, splat(0), row[n]);
        step = v_maximum(step, v_abs(row[n]));
        largest = v_maximum(largest, v_abs(at.U[t * m + i]));
        unit += Q(t, (n + i) * (k + 1)) / static_cast<real>(T * m);
      }
    const mask helped = line_search();
    const mask same = at_same_bounds();
    const vec before = at.cost;
    std::swap(at, now);
    for (int64_t i = 0; i < T * m; i++)
      for (int j = 0; j < n; j++) K[i * n + j] = gains[i * (n + 1) + j];
    return judge(before, helped, step / (splat(1) + largest), unit, same);
  }

  // The full step where it helps, else the best of several shorter ones, else none.
  mask line_search() {
    const vec rounding = 8 * EPS * v_abs(at.cost);
    follow(1, now);
    const mask full = now.cost <= at.cost + v_maximum(real(1e-4) * change, -rounding) + rounding;
    if (!any(!full)) return full;
    choose(full, now, at, best);
    for (const real length : SHORTER) {
      follow(length, tried);
      choose(!full & (tried.cost < best.cost), tried, best, best);
    }
    std::swap(now, best);
    return full | (now.cost < at.cost);
  }

  mask at_same_bounds() const {
    mask other = none();
    for (int64_t t = 0; bounded && t < T; t++) {
      vec low[m], high[m];
      bounds(t, &at.U[t * m], low, high);
      for (int i = 0; i < m; i++) {
        const vec a = at.U[t * m + i], b = now.U[t * m + i];
        other = other | ((a <= low[i]) != (b <= low[i])) | ((a >= high[i]) != (b >= high[i]));
      }
    }
    return !other;
  }

  // As control/verdict.py explains.
  mask judge(vec before, mask helped, vec new_size, vec unit, mask same_bounds) {
    const vec zero = splat(0), one = splat(1), rounding = 8 * EPS * v_abs(before);
    const real small = std::sqrt(EPS), tiny = std::pow(EPS, real(0.6));
    const vec kept = (before - at.cost) / v_maximum(-change, splat(EPS * EPS));
    const mask newton = exact != zero, tiny_step = new_size <= splat(small);
    const mask at_rest = tiny_step | (!helped & (-change <= rounding));
    const mask as_promised =
        helped & (v_abs(before + change - at.cost) <= real(-0.1) * change + rounding);
    const vec last = v_maximum(size, splat(EPS));
    const vec next_size = new_size * new_size * v_maximum(new_size / (last * last), one);
    const mask arrives =
        newton & (damping == zero) & as_promised & same_bounds & (next_size <= splat(tiny));

    const mask near = size < splat(NEAR);
    const mask misled = ((kept < splat(0.25)) & !tiny_step) | (failed & (near | !newton));
    const mask steady = ((kept > splat(0.75)) | at_rest) & !failed;
    const mask ends_quickly = (kept < splat(0.8)) | (new_size < splat(0.25));
    const vec raised = where(damping > real(1e-4) * unit, 10 * damping, real(1e-3) * unit);
    const vec lowered = where(damping > real(1e-6) * unit, damping / 10, zero);
    const mask converged = (at_rest | arrives) & !failed & (damping <= unit);
    promised = where(failed, splat(INF), -change);
    size = where(failed, size, new_size);
    damping = where(misled, raised, where(steady, lowered, damping));
    exact = where((failed & near) | (!failed & ends_quickly), one, zero);
    return converged;
  }
};

// Copies one lane's numbers, or all of them back.
static void put(vec *to, int i, const real *from, int64_t steps, int64_t size, int64_t by_time) {
  for (int64_t t = 0; t < steps; t++)
    for (int64_t j = 0; j < size; j++) lane(to[t * size + j], i) = from[t * by_time + j];
}

static void take(const vec *from, int i, real *to, int64_t steps, int64_t size, int64_t by_time) {
  for (int64_t t = 0; t < steps; t++)
    for (int64_t j = 0; j < size; j++) to[t * by_time + j] = lane(from[t * size + j], i);
}

static void begin(Optimizer &o, int i, int64_t b, const Iterate &at) {
  const int64_t T = o.T, B = o.problem.B;
  o.load(i, b);
  put(o.at.X.data(), i, at.X + b * n, T + 1, n, B * n);
  put(o.at.U.data(), i, at.U + b * m, T, m, B * m);
  put(o.K.data(), i, at.K + b * m * n, T, m * n, B * m * n);
  lane(o.at.cost, i) = at.cost[b];
  lane(o.size, i) = at.size[b];
  lane(o.damping, i) = at.damping[b];
  lane(o.exact, i) = at.exact[b];
}

static void end(const Optimizer &o, int i, int64_t b, Iterate &at) {
  const int64_t T = o.T, B = o.problem.B;
  take(o.at.X.data(), i, at.X + b * n, T + 1, n, B * n);
  take(o.at.U.data(), i, at.U + b * m, T, m, B * m);
  take(o.K.data(), i, at.K + b * m * n, T, m * n, B * m * n);
  at.cost[b] = lane(o.at.cost, i);
  at.promised[b] = lane(o.promised, i);
  at.size[b] = lane(o.size, i);
  at.damping[b] = lane(o.damping, i);
  at.exact[b] = lane(o.exact, i) != 0;
}

// Sweeps members of a batch, taken from a common queue, until none is left.
static int64_t work(const Problem &problem, Iterate &at, int64_t sweeps,
                    std::atomic<int64_t> &queue) {
  Optimizer o(problem);
  int64_t member[lanes], done[lanes], busy = 0, most = 0;
  std::fill(member, member + lanes, -1);
  for (;;) {
    vec fresh = splat(0);
    for (int i = 0; i < lanes; i++)
      while (member[i] < 0) {
        const int64_t b = queue++;
        if (b >= problem.B) break;
        if (at.converged[b]) continue;
        begin(o, i, b, at);
        member[i] = b, done[i] = 0, busy++;
        lane(fresh, i) = at.iterations[b] == 0;
      }
    if (!busy) return most;
    if (any(fresh != splat(0))) {
      o.start(fresh != splat(0));
      const vec strange = where(o.strange, splat(1), splat(0));
      for (int i = 0; i < lanes; i++)
        if (lane(fresh, i) != 0) {
          at.history[member[i]] = lane(o.at.cost, i);
          at.strange[member[i]] = lane(strange, i) != 0;
        }
    }
    const vec converged = where(o.improve(), splat(1), splat(0));
    const vec strange = where(o.strange, splat(1), splat(0));
    for (int i = 0; i < lanes; i++) {
      const int64_t b = member[i];
      if (b < 0) continue;
      done[i]++, at.iterations[b]++;
      at.history[done[i] * problem.B + b] = lane(o.at.cost, i);
      at.converged[b] = lane(converged, i) != 0;
      at.strange[b] |= lane(strange, i) != 0;
      most = std::max(most, done[i]);
      if (!at.converged[b] && !at.strange[b] && done[i] < sweeps) continue;
      end(o, i, b, at);
      member[i] = -1, busy--;
    }
  }
}

// Sweeps every plan that has not converged, at most so many times; returns the most it took.
extern "C" int64_t plan(const Problem *problem, Iterate *at, int64_t sweeps, int64_t threads) {
  std::atomic<int64_t> queue(0);
  std::vector<int64_t> most(threads);
  std::vector<std::thread> others;
  auto run = [&](int64_t i) { most[i] = work(*problem, *at, sweeps, queue); };
  for (int64_t i = 1; i < threads; i++) others.emplace_back(run, i);
  run(0);
  for (std::thread &other : others) other.join();
  return *std::max_element(most.begin(), most.end());
}

// The functions of one step at one point: y (n), F (n, k) and S (k, k), one after another.
extern "C" void probe(int64_t kind, int64_t t, const real *x, const real *u, const real *numbers,
                      const real *l, real *results) {
  vec x_[n], u_[m], l_[n], numbers_[COUNT + 1], values[n + n * k + k * k];
  for (int i = 0; i < n; i++) x_[i] = splat(x[i]), l_[i] = splat(l[i]);
  for (int i = 0; i < m; i++) u_[i] = splat(u[i]);
  for (int i = 0; i < COUNT; i++) numbers_[i] = splat(numbers[i]);
  const vec time = splat(static_cast<real>(t));
  transition(kind, x_, u_, time, numbers_, values);
  slopes(kind, x_, u_, time, numbers_, values + n);
  curvature(kind, x_, u_, time, numbers_, l_, values + n + n * k);
  for (int i = 0; i < n + n * k + k * k; i++) results[i] = lane(values[i], 0);
}
