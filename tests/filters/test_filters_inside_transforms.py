"""torch.vmap, torch.func.grad and jacrev see the filters as plain functions of tensors."""

import pytest
import torch
from filter_helpers import FILTERS, Bend, close, draw, linear, one_step, record
from torch.func import functional_call, grad, hessian, jacfwd, jacrev, vmap

from pypose_lite.filters import EKF, PF, UKF, angles, nees, sigma_points, smooth
from pypose_lite.filters.gaussian import factor

pytestmark = pytest.mark.filterwarnings("ignore:PF")
gaussian = pytest.mark.parametrize("kind", [EKF, UKF])
every = pytest.mark.parametrize("kind", FILTERS.values(), ids=FILTERS)
NAMES = ["x", "y", "u", "P", "Q", "R"]


def equal(got, want, atol=1e-12):
    for a, b in zip(got, want, strict=True):
        close(a, b, atol)


@gaussian
def test_vmap_over_all_arguments_is_the_batch(g, kind):
    args, filter = one_step(g, (5,)), kind(Bend())
    equal(vmap(filter)(*args), filter(*args))
    equal(vmap(vmap(filter))(*(a[None] for a in args)), [z[None] for z in filter(*args)])


@gaussian
@pytest.mark.parametrize("which", NAMES)
def test_vmap_over_one_argument_is_the_batch(g, kind, which):
    args, i = list(one_step(g)), NAMES.index(which)
    args[i] = one_step(g, (5,))[i]
    dims = tuple(0 if name == which else None for name in NAMES)
    filter = kind(Bend())
    equal(vmap(filter, dims)(*args), filter(*args))


@gaussian
@pytest.mark.parametrize("method", ["update", "innovation", "predict", "reverse"])
def test_vmap_over_the_parts(g, kind, method):
    x, y, u, P, Q, R = one_step(g, (5,))
    args = (x, y, u, P, R) if method in ("update", "innovation") else (x, u, P, Q)
    part = getattr(kind(Bend()), method)
    equal(vmap(part)(*args), part(*args))


@gaussian
def test_vmap_with_missing_rows_sensors_and_correlated_noise(g, kind):
    x, y, u, P, Q, R = one_step(g, (5,))
    filter, S = kind(Bend()), 0.01 * draw(g, 5, 2, 2)
    y = y.masked_fill(torch.rand(5, 2, generator=g) < 0.5, torch.nan)
    equal(
        vmap(lambda x, y, u, P, Q, R, S: filter(x, y, u, P, Q, R, S=S))(x, y, u, P, Q, R, S),
        filter(x, y, u, P, Q, R, S=S),
    )

    def sensor(x, y, P):
        return filter.update(x, y, None, P, R=torch.eye(2), g=lambda state: state**2)

    equal(vmap(sensor)(x, y, P), sensor(x, y, P))


@gaussian
def test_vmap_of_beliefs_without_full_rank(g, kind):
    x, y, u, P, Q, R = one_step(g, (3,))
    P = torch.stack([P[0], torch.zeros(2, 2), torch.ones(2, 2)])
    filter = kind(Bend())
    equal(vmap(filter)(x, y, u, P, 0 * Q, R), filter(x, y, u, P, 0 * Q, R))


def test_in_vmap_what_is_no_covariance_is_nan_and_the_others_stay(g):
    x, y, u, P, Q, R = one_step(g, (3,))
    P[1] = torch.diag(torch.tensor([1.0, -1.0]))
    got = vmap(EKF(Bend()))(x, y, u, P, Q, R)
    want = EKF(Bend())(x[0], y[0], u[0], P[0], Q[0], R[0])
    assert got[0][1].isnan().all()
    equal([z[0] for z in got], want)
    R[2] = -R[2] * 1e3
    assert vmap(EKF(Bend()).update)(x, y, u, P, R)[0][2].isnan().all()


@gaussian
def test_vmap_across_the_cut(g, kind):
    wrap = angles(0)
    filter = kind(Bend(), residual=wrap, residual_x=wrap)
    x, y, u, P, Q, R = one_step(g, (5,))
    x, y = x + torch.tensor([3.1, 0]), y - torch.tensor([3.1, 0])
    equal(vmap(filter)(x, y, u, P, Q, R), filter(x, y, u, P, Q, R))
    equal([vmap(lambda *a: nees(*a, wrap))(x, P, -x)], [nees(x, P, -x, wrap)])


@gaussian
def test_vmap_over_a_run_and_its_smoother(g, kind):
    x, _, _, P, Q, R = one_step(g, (3,))
    u, y, filter = draw(g, 3, 4, 1), draw(g, 3, 4, 2), kind(Bend())
    y[0, 1] = torch.nan

    def run(x, P, y, u, Q, R):
        return smooth(filter, *record(filter, x, P, y, u, Q, R), y, u, Q, R)

    equal(vmap(run)(x, P, y, u, Q, R), run(x, P, y, u, Q, R))


@gaussian
@pytest.mark.parametrize("which", range(6))
def test_jacobians_of_transforms_are_those_of_autograd(g, kind, which):
    args, filter = one_step(g), kind(Bend())

    def mean(*args):
        return filter(*args)[0]

    want = torch.autograd.functional.jacobian(mean, args)[which]
    close(jacrev(mean, which)(*args), want)
    close(jacfwd(mean, which)(*args), want)
    close(grad(lambda *a: mean(*a).sum(), which)(*args), want.sum(0))
    batch = one_step(g, (3,))
    mapped = vmap(jacrev(mean, which))(*batch)
    for i in range(3):
        close(mapped[i], jacrev(mean, which)(*(a[i] for a in batch)))


@gaussian
def test_second_derivatives_of_transforms_are_those_of_autograd(g, kind):
    x, *rest = one_step(g)
    filter = kind(Bend())

    def loss(x):
        mean, P = filter(x, *rest)
        return mean.square().sum() + P.sum()

    close(hessian(loss)(x), torch.autograd.functional.hessian(loss, x), 1e-10)


@gaussian
def test_gradients_of_a_likelihood_in_the_models_parameter_for_many_of_them(g, kind):
    """vmap over parameters: what a search over models does."""
    filter, (x, y, u, P, Q, R) = kind(Bend()), one_step(g)

    def loss(strength):
        model = {"model.strength": strength}
        mean, P_after = functional_call(filter, model, (x, y, u, P, Q, R))
        return mean.sum() + P_after.sum()

    some = torch.tensor([0.1, 0.3, 0.7])
    got, slopes = vmap(loss)(some), vmap(grad(loss))(some)
    for i, strength in enumerate(some):
        tracked = strength.clone().requires_grad_()
        close(got[i], loss(strength).detach())
        close(slopes[i], torch.autograd.grad(loss(tracked), tracked)[0])


@gaussian
def test_the_smoothers_jacobian(g, kind):
    x, _, _, P, Q, R = one_step(g)
    u, y, filter = draw(g, 4, 1), draw(g, 4, 2), kind(Bend(), Q, R)

    def run(y):
        return smooth(filter, *record(filter, x, P, y, u), y, u)[0]

    close(jacrev(run)(y), torch.autograd.functional.jacobian(run, y))


def test_sigma_points_and_roots_of_either_kind(g):
    P = one_step(g, (4,))[3]
    equal([vmap(lambda P: sigma_points(P)[0])(P)], [sigma_points(P)[0]])
    equal([vmap(factor)(P)], [factor(P)])
    args = one_step(g, (4,))
    for msqrt in (torch.linalg.cholesky, lambda P: torch.linalg.cholesky(P).mT):
        ukf = UKF(Bend(), msqrt=msqrt)
        equal(vmap(ukf)(*args), ukf(*args))


def test_particles_in_vmap_draw_for_each_member(g):
    """With randomness of their own; the mean of many is that of the exact filter."""
    system = linear(g)
    pf, kf = (kind(system.model, system.Q, system.R) for kind in (PF, EKF))
    pf.particles = 100_000
    x, y = system.x + 0.1 * draw(g, 3, 2), system.x + draw(g, 3, 2)
    u = draw(g, 3, 1)

    def step(x, y, u):
        return pf(x, y, u, system.P)

    torch.manual_seed(0)
    got = vmap(step, randomness="different")(x, y, u)
    want = kf(x, y, u, system.P)
    equal(got, want, 0.05)
    same = vmap(step, randomness="different")(*(z[:1].expand(3, -1) for z in (x, y, u)))
    assert (same[0][0] != same[0][1]).any()


def test_kept_particles_in_vmap(g):
    x, y, u, P, Q, R = one_step(g, (3,))
    pf = PF(Bend(), particles=50)
    particles = pf.draw(x, P, g)
    equal(vmap(pf.weigh)(particles, y, u, R), pf.weigh(particles, y, u, R))
    particles.x[0, 0] = torch.nan_to_num(particles.x[0, 0])
    want = pf.log_likelihood(particles, y, u, R)
    equal([vmap(pf.log_likelihood)(particles, y, u, R)], [want])
    torch.manual_seed(0)
    after = vmap(pf.step, randomness="different")(particles, y, u, Q, R)
    many = PF(Bend(), particles=50_000)
    exact = many.step(many.draw(x, P, g), y, u, Q, R, generator=g)
    assert after.x.shape == (3, 50, 2)
    close(after.mean, exact.mean, 0.6)


def test_particles_without_a_likelihood_in_vmap(g):
    """Where g is not defined, a particle has weight 0 here as there."""

    class Logarithm(Bend):
        def observation(self, state, input, t=None):
            return state.log()

    x, y, u, _, _, R = one_step(g, (3,))
    pf = PF(Logarithm(), particles=20)
    particles = pf.draw(x.abs() + 0.3, 0.1 * torch.eye(2), g)
    lost = (particles.x <= 0).any(-1)
    assert lost.any()
    got = vmap(pf.weigh)(particles, y, u, R)
    assert (got.w[lost] == 0).all()
    equal(got, pf.weigh(particles, y, u, R))


def test_without_randomness_vmap_says_what_to_do(g):
    x, y, u, P, Q, R = one_step(g, (3,))
    with pytest.raises(RuntimeError, match="randomness"):
        vmap(PF(Bend()))(x, y, u, P, Q, R)


@every
def test_gradients_of_transforms_of_every_kind(g, kind):
    x, *rest = one_step(g)
    filter = kind(Bend(), particles=20) if kind is PF else kind(Bend())
    seed = {"generator": torch.Generator()} if kind is PF else {}

    def mean(x):
        if seed:
            seed["generator"].manual_seed(1)
        return filter(x, *rest, **seed)[0]

    want = torch.autograd.functional.jacobian(mean, x)
    close(jacrev(mean)(x), want)
    close(grad(lambda x: mean(x).sum())(x), want.sum(0))
