# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The mathematics used
#
# Five pieces of mathematics carry this book: Gaussian distributions, the Schur complement, the
# Riccati equation, the groups of rotations and poses, and the implicit function theorem. Each of
# them is explained here on about two pages, with the formulas that the chapters use, and with a few
# cells that check them on numbers. You need matrices, eigenvalues and partial derivatives.
#
# Read a section when a chapter sends you here, or all of them before you begin.

# %% tags=["setup"]
import math

import matplotlib.pyplot as plt
import torch

import pypose_lite as pp
from pypose_lite import lie
from pypose_lite.teaching import claim, plotting

plotting.use_style()
torch.set_default_dtype(torch.float64)
torch.set_printoptions(precision=3, sci_mode=False)
generator = torch.Generator().manual_seed(0)

# %% [markdown]
# ## Gaussian distributions
#
# *Used in chapters [4](04_ekf.py), [5](05_ukf_pf.py) and [7](07_all_together.py).*
#
# We describe what we know of an unknown number $x$ by a probability density $p(x)$. It is high
# where $x$ is likely to be, and its integral is one. Two averages summarise it. The *mean* is
# $m = E[x]$, and the *variance* is $P = E[(x - m)^2]$, whose root is the standard deviation. A
# {term}`Gaussian` is the density that is determined by these two:
#
# $$
# p(x) = \frac{1}{\sqrt{2 \pi P}} \exp\Bigl(-\frac{(x - m)^2}{2 P}\Bigr)
# $$ (eq-m-scalar)
#
# We write $x \sim \mathcal{N}(m, P)$. For a vector of $n$ numbers the variance becomes the
# *covariance matrix* $P = E[(x - m)(x - m)^\top]$. Its diagonal holds the variances, and each other
# entry says whether two of the numbers tend to deviate together:
#
# $$
# \begin{aligned}
# p(x) &= \frac{\exp(-\tfrac12 d^2)}{\sqrt{\det(2 \pi P)}}, \\
# d^2 &= (x - m)^\top P^{-1} (x - m)
# \end{aligned}
# $$ (eq-m-gaussian)
#
# Points of equal density have the same $d$, the *Mahalanobis distance* from the mean. They lie on
# an ellipse. Its axes are the eigenvectors of $P$, and its half axes are the roots of the
# eigenvalues, times $d$.

# %%
mean = torch.tensor([0.5, 0.2])  # m
P = torch.tensor([[0.09, 0.05], [0.05, 0.05]])  # m²
L = torch.linalg.cholesky(P)  # a root of P: L L' = P
draws = mean + torch.randn(2000, 2, generator=generator) @ L.mT

# %% tags=["hide-input"]
variances, axes = torch.linalg.eigh(P)
turn = torch.linspace(0, 2 * math.pi, 100)
circle = torch.stack([turn.cos(), turn.sin()], -1)
fig, ax = plt.subplots(figsize=(7, 4.6))
ax.plot(*draws.mT, ".", ms=2, color=plotting.GREY, alpha=0.4, label="draws")
for d, color in ((1, plotting.ORANGE), (2, plotting.BLUE)):
    ellipse = mean + d * circle @ L.mT
    ax.plot(*ellipse.mT, color=color, lw=2, label=f"d = {d}")
for variance, axis in zip(variances, axes.mT):
    half_axis = 2 * variance.sqrt() * axis
    ax.annotate("", mean + half_axis, mean, arrowprops={"arrowstyle": "->", "lw": 2})
ax.set(xlabel="i (m)", ylabel="j (m)", aspect="equal", ylim=(-0.7, 1.3))
ax.legend(loc="upper left", markerscale=4)
plotting.show(
    fig,
    "A cloud of draws from a Gaussian of two dimensions, longer than wide and "
    "tilted. Two ellipses around its mean, for d = 1 and d = 2, and two arrows along "
    "the half axes of the larger one.",
)

# %% tags=["claims"]
standard = torch.linalg.solve_triangular(L, (draws - mean).mT, upper=False)
distance = standard.norm(dim=0)
share_one = 100 * (distance < 1).double().mean()
share_two = 100 * (distance < 2).double().mean()
law_one = 100 * (1 - math.exp(-1 / 2))
law_two = 100 * (1 - math.exp(-4 / 2))
claim("inside_one", share_one, equals=law_one, within=4, unit="%")
claim("inside_two", share_two, equals=law_two, within=3, unit="%")

# %% [markdown]
# The cell made its draws by a root of the covariance: if $z$ has independent entries of variance
# one, then $m + L z$ has the mean $m$ and the covariance $L L^\top$. This is the first of three
# rules that make Gaussians easy to compute with.
#
# **Linear functions.** If $x \sim \mathcal{N}(m, P)$, then $A x + b$ is Gaussian, too. Its
# deviation from its mean is $A (x - m)$, so that its covariance is
# $E[A (x - m)(x - m)^\top A^\top] = A P A^\top$:
#
# $$ A x + b \sim \mathcal{N}(A m + b,\; A P A^\top) $$ (eq-m-linear)
#
# **Sums.** If $w \sim \mathcal{N}(0, Q)$ is independent of $x$, the mixed terms are zero on
# average, and covariances add: $x + w \sim \mathcal{N}(m, P + Q)$.
#
# **How far is far?** The squared distance $d^2$ of a draw from its mean is a sum of $n$ squares of
# independent numbers of variance one. Its distribution is called
# {term}`chi-square <Chi-square distribution>` with $n$ degrees of freedom. Its mean is $n$. In two
# dimensions $d^2$ is less than $c$ with the probability $1 - e^{-c/2}$: of our draws,
# {claim}`inside_one` lie inside the inner ellipse and {claim}`inside_two` inside the outer one. In
# one dimension it would be 68 % and 95 %, so an ellipse of $d = 2$ promises less than a reader may
# expect. The ellipses of the chapters hold 95 %, for which $d$ is the root of $-2 \log 0.05$, about
# 2.45. <!-- given: 68 %, 95 %, 2.45 -->
#
# **Nonlinear functions** do not keep a Gaussian Gaussian. Two remedies are used: replace the
# function by its tangent at the mean and apply {eq}`eq-m-linear`, as the extended Kalman filter of
# chapter 4 does, or send chosen points through it and take their mean and covariance, as chapter 5
# does.

# %% [markdown]
# ## The Schur complement
#
# *Used in chapters [2](02_lqr.py), [3](03_mpc.py) and [4](04_ekf.py).*
#
# The two central formulas of this book, the gain of a regulator and the gain of a Kalman filter,
# are the same piece of linear algebra. It answers the question what is left of a quadratic function
# when one of its variables has been dealt with. Take a quadratic in two vectors with a symmetric,
# positive definite matrix in blocks:
#
# $$
# f(x, u) = \tfrac12
# \begin{bmatrix} x \\ u \end{bmatrix}^\top
# \begin{bmatrix} H_{xx} & H_{xu} \\ H_{ux} & H_{uu} \end{bmatrix}
# \begin{bmatrix} x \\ u \end{bmatrix}
# $$ (eq-m-blocks)
#
# Let $x$ be fixed and choose the best $u$. The derivative by $u$ is $H_{ux} x + H_{uu} u$. It is
# zero at
#
# $$ u = -H_{uu}^{-1} H_{ux}\, x $$ (eq-m-argmin)
#
# and if this $u$ is put in, the function of $x$ that remains is
#
# $$
# \begin{aligned}
# \min_u f(x, u) &= \tfrac12 x^\top S\, x, \\
# S &= H_{xx} - H_{xu} H_{uu}^{-1} H_{ux}
# \end{aligned}
# $$ (eq-m-schur)
#
# $S$ is the {term}`Schur complement` of $H_{uu}$. It is smaller than $H_{xx}$: whoever may choose
# $u$ pays less than with $u = 0$. Elimination of unknowns in a system of equations gives the same
# $S$, and it is what remains in the corner of an inverse:
#
# $$ (H^{-1})_{xx} = S^{-1} $$ (eq-m-inverse)

# %%
root = torch.randn(5, 5, generator=generator)
H = root @ root.mT + torch.eye(5)
Hxx = H[:3, :3]
Hxu = H[:3, 3:]
Hux = H[3:, :3]
Huu = H[3:, 3:]
S = Hxx - Hxu @ torch.linalg.solve(Huu, Hux)
print("Schur complement:\n", S)
corner = torch.linalg.inv(H)[:3, :3]
print("inverse of the corner of the inverse:\n", torch.linalg.inv(corner))

# %% tags=["claims"]
difference = S - torch.linalg.inv(corner)
claim("schur_corner", difference.abs().max(), below=1e-12)
claim("schur_smaller", torch.linalg.eigvalsh(Hxx - S).min(), above=0)

# %% [markdown]
# **In control** $f$ is the cost of a step together with the cost-to-go of the next state. Equation
# {eq}`eq-m-argmin` is the feedback $u = K x$ of chapter 2, and $S$ is the cost-to-go one step
# earlier.
#
# **In estimation** the quadratic is the exponent of a Gaussian. Let $x$ and $y$ be Gaussian
# together, for example a state and its measurement:
#
# $$
# \begin{bmatrix} x \\ y \end{bmatrix} \sim \mathcal{N}\left(
# \begin{bmatrix} m_x \\ m_y \end{bmatrix},
# \begin{bmatrix} P_{xx} & P_{xy} \\ P_{yx} & P_{yy} \end{bmatrix} \right)
# $$ (eq-m-joint)
#
# What do we know of $x$ once $y$ has been measured? Consider $e = x - K y$ for some matrix $K$.
# Its covariance with $y$ is $P_{xy} - K P_{yy}$, which is zero for
#
# $$ K = P_{xy} P_{yy}^{-1} $$ (eq-m-gain)
#
# For Gaussians that means that $e$ and $y$ are independent, and so the measurement tells nothing
# about $e$. All that we learn of $x = e + K y$ is therefore the part $K y$, and what remains
# uncertain is $e$:
#
# $$
# \begin{aligned}
# E[x \mid y] &= m_x + K (y - m_y), \\
# \operatorname{cov}[x \mid y] &= P_{xx} - P_{xy} P_{yy}^{-1} P_{yx}
# \end{aligned}
# $$ (eq-m-conditional)
#
# The covariance that is left is a Schur complement again. For a measurement $y = C x + v$ with
# noise of covariance $R$, the rules of the last section give $P_{xy} = P C^\top$ and
# $P_{yy} = C P C^\top + R$, and {eq}`eq-m-gain` and {eq}`eq-m-conditional` become the Kalman
# filter's correction.
#
# **The same by information.** The product of the densities {eq}`eq-m-gaussian` of the belief and of
# the measurement adds their exponents, so inverses of covariances add. What is left by
# {eq}`eq-m-conditional` must be the same matrix:
#
# $$
# \begin{aligned}
# & (P^{-1} + C^\top R^{-1} C)^{-1} \\
# & = P - P C^\top (C P C^\top + R)^{-1} C P
# \end{aligned}
# $$ (eq-m-woodbury)
#
# This is the *matrix inversion lemma*. One reads it from left to right when there are many numbers
# in the state and few in the measurement: then the matrix to invert on the right is the smaller
# one.

# %%
P = torch.diag(torch.tensor([0.04, 0.09, 0.01]))
C = torch.tensor([[1.0, 0.0, 2.0]])
R = torch.tensor([[0.02]])
information = torch.linalg.inv(P) + C.mT @ torch.linalg.inv(R) @ C
by_information = torch.linalg.inv(information)
by_gain = P - P @ C.mT @ torch.linalg.solve(C @ P @ C.mT + R, C @ P)
print(by_gain)

# %% tags=["claims"]
claim("woodbury", (by_information - by_gain).abs().max(), below=1e-14)

# %% [markdown]
# ## The Riccati equation and its dual
#
# *Used in chapters [2](02_lqr.py), [3](03_mpc.py), [4](04_ekf.py) and [8](08_learning.py).*
#
# Repeating the Schur complement step by step gives a recursion. For the regulator it runs backward
# in time, from the cost-to-go $V$ of the next state to that of the present one. With a cost
# $\tfrac12 x^\top Q x + \tfrac12 u^\top R u$ in each step, chapter 2's recursion reads
#
# $$
# \begin{aligned}
# V \leftarrow\; & Q + A^\top V A \\
# & - A^\top V B\, (R + B^\top V B)^{-1} B^\top V A
# \end{aligned}
# $$ (eq-m-control)
#
# For the filter it runs forward, from the covariance $P$ of one prediction to that of the next,
# with the covariances $Q$ of the process noise and $R$ of the measurement's:
#
# $$
# \begin{aligned}
# P \leftarrow\; & Q + A P A^\top \\
# & - A P C^\top (R + C P C^\top)^{-1} C P A^\top
# \end{aligned}
# $$ (eq-m-filter)
#
# They are one equation: replace $A$ by $A^\top$ and $B$ by $C^\top$ in the first, and it is the
# second. This is called *duality*. A program that solves one of them solves both:

# %%
A = torch.tensor([[1.0, 0.1], [0.0, 1.0]])  # position and speed, steps of 0.1 s
C = torch.tensor([[1.0, 0.0]])  # the position is measured
Q = torch.diag(torch.tensor([0.0, 0.01]))
R = torch.tensor([[0.25]])
_, by_duality = pp.dlqr(A.mT, C.mT, Q, R)

covariance = torch.eye(2)
for _ in range(500):
    gain = torch.linalg.solve(R + C @ covariance @ C.mT, C @ covariance @ A.mT).mT
    covariance = Q + (A - gain @ C) @ covariance @ A.mT  # (13)
print("the filter's covariance after many steps:\n", covariance)
print("the regulator's equation with transposed matrices:\n", by_duality)

# %% tags=["claims"]
claim("duality", (covariance - by_duality).abs().max(), below=1e-9)

# %% [markdown]
# **Why it settles.** In one dimension one can see it. Chapter 2's example has $A = B = Q = R = 1$,
# and {eq}`eq-m-control` becomes $V \leftarrow 1 + V / (1 + V)$. Draw this function and the
# diagonal. Each step of the recursion goes up or down to the curve and then across to the diagonal.
# The curve is rising and its slope $1 / (1 + V)^2$ is less than one, so every step shortens the
# distance to the crossing, from whichever side one comes.

# %% tags=["hide-input"]
values = torch.linspace(0, 3, 200)


def riccati(V):
    return 1 + V / (1 + V)


fig, ax = plt.subplots(figsize=(7, 4))
ax.plot(values, riccati(values), label="one step of the recursion")
ax.plot(values, values, color="black", lw=1, label="the diagonal")
ends = []
for start, color in ((0.0, plotting.ORANGE), (2.8, plotting.GREY)):
    way = [(start, start)]
    for _ in range(6):
        V = way[-1][1]
        way += [(V, riccati(V)), (riccati(V), riccati(V))]
    ax.plot(*zip(*way), "--", color=color, label=f"from V = {start:g}")
    ends.append(way[-1][1])
ax.set(xlabel="V", ylabel="V, one step earlier", xlim=(0, 3), ylim=(0, 3))
ax.legend(loc="lower right")
plotting.show(
    fig,
    "A rising curve that becomes flatter and crosses the diagonal once. Two "
    "staircases between them, one from below and one from above, end there.",
)

# %% tags=["claims"]
golden = (1 + math.sqrt(5)) / 2
claim("riccati_below", ends[0], equals=golden, within=1e-3)
claim("riccati_above", ends[1], equals=golden, within=1e-3)

# %% [markdown]
# Both staircases end in the golden ratio, {claim}`riccati_below`. In general the recursion settles
# on one solution if every growing motion can be steered and every growing motion is seen by the
# cost ({term}`stabilisability` and {term}`detectability`). For the filter the two change places:
# every growing motion must be seen by the measurement and shaken by the noise. Where that fails,
# the recursion may grow without bounds, and the programs of this book say so.
#
# **Why it is computed with care.** The last term of {eq}`eq-m-filter` is subtracted. If the sensor
# is precise, nearly equal matrices are subtracted, and rounding can leave a matrix with a negative
# eigenvalue, which is not a covariance. *Joseph's form* of the correction is a sum of squares:
#
# $$ (I - K C) P (I - K C)^\top + K R K^\top $$ (eq-m-joseph)
#
# It is the covariance of $x - \hat x$ for the estimate $\hat x = m + K (y - C m)$, whatever matrix
# $K$ is. Chapter 4 derives it.

# %% [markdown]
# ## Rotations and poses
#
# *Used in chapter [6](06_splines.py), and wherever a heading is an angle.*
#
# Vectors can be added. Rotations cannot: the sum of two rotation matrices is no rotation matrix.
# But they can be multiplied and inverted, and the results are rotations again. A set with such a
# multiplication is called a *group*. If it is smooth, like the rotations of the plane, which form a
# circle, it is a {term}`Lie group`. At the identity it has a tangent, a space of ordinary vectors,
# where one can add, average and interpolate. The exponential map leads from the tangent to the
# group, and the logarithm leads back.

# %% tags=["hide-input"]
angles = torch.tensor([0.5, 1.0, 1.5])
rotations = lie.so2_exp(angles[:, None])
fig, ax = plt.subplots(figsize=(7, 4.6))
ax.plot(*circle.mT, color=plotting.BLUE, label="the group: rotations [cos, sin]")
ax.axvline(1, color=plotting.ORANGE, label="the tangent at the identity")
ax.plot(1, 0, "ko", label="the identity")
for angle, rotation in zip(angles, rotations):
    tip = torch.tensor([1.0, float(angle)])
    ax.plot(*tip, "s", color=plotting.ORANGE)
    ax.plot(*rotation, "o", color=plotting.BLUE)
    bend = {"arrowstyle": "->", "connectionstyle": "arc3,rad=0.2"}
    ax.annotate("", rotation, tip, arrowprops=bend)
    ax.annotate(f"{angle:g} rad", tip, xytext=(8, -4), textcoords="offset points")
ax.set(xlabel="cos", ylabel="sin", aspect="equal", xlim=(-1.3, 2.9), ylim=(-1.2, 1.9))
ax.legend(loc="lower right")
plotting.show(
    fig,
    "A circle of radius 1 and the vertical line that touches it at the right. Arrows "
    "lead from points on the line to points on the circle that lie as far along it.",
)

# %% tags=["claims"]
wrapped = torch.atan2(rotations[:, 1], rotations[:, 0])
claim("wraps", (wrapped - angles).abs().max(), below=1e-12)

# %% [markdown]
# In the plane the exponential map wraps the tangent line around the circle. In space it works like
# this. A body that turns with the constant angular velocity $\phi$ (a vector along the axis, with
# the speed as its length) moves each of its points $p$ with the velocity $\phi \times p$. The cross
# product is linear in $p$, so it is a matrix, which is written with a *hat*:
#
# $$
# \hat\phi =
# \begin{bmatrix}
# 0 & -\phi_3 & \phi_2 \\ \phi_3 & 0 & -\phi_1 \\ -\phi_2 & \phi_1 & 0
# \end{bmatrix}
# $$ (eq-m-hat)
#
# The differential equation $\dot p = \hat\phi\, p$ has the solution
# $p(t) = \exp(t \hat\phi)\, p(0)$ with the series of the exponential function. After one second the
# body has turned by
#
# $$ \exp(\hat\phi) = I + \hat\phi + \tfrac12 \hat\phi^2 + \tfrac16 \hat\phi^3 + \dots $$ (eq-m-exp)
#
# Let $\theta$ be the length of $\phi$. Multiplying out shows that
# $\hat\phi^3 = -\theta^2 \hat\phi$. So every odd power is a multiple of $\hat\phi$ and every even
# one of $\hat\phi^2$, and the two series of numbers are those of the sine and of the cosine:
#
# $$
# \exp(\hat\phi) = I + \frac{\sin\theta}{\theta}\, \hat\phi
# + \frac{1 - \cos\theta}{\theta^2}\, \hat\phi^2
# $$ (eq-m-rodrigues)
#
# This is *Rodrigues' formula*. At $\theta = 0$ the fractions are 1 and $\tfrac12$; a program has to
# take them from their series there, or it divides zero by zero.


# %%
def hat(phi):
    """Returns the matrix of the cross product with phi."""
    zero = torch.zeros(())
    rows = [zero, -phi[2], phi[1], phi[2], zero, -phi[0], -phi[1], phi[0], zero]
    return torch.stack(rows).reshape(3, 3)


phi = torch.tensor([0.3, -0.5, 1.1])
theta = phi.norm()
sine_part = theta.sin() / theta
cosine_part = (1 - theta.cos()) / theta**2
rodrigues = torch.eye(3) + sine_part * hat(phi) + cosine_part * hat(phi) @ hat(phi)
print(rodrigues)

# %% tags=["claims"]
claim("rodrigues", (rodrigues - torch.matrix_exp(hat(phi))).abs().max(), below=1e-14)
by_library = lie.so3_matrix(lie.so3_exp(phi))
claim("library_exp", (rodrigues - by_library).abs().max(), below=1e-14)

# %% [markdown]
# **Quaternions** store a rotation in four numbers instead of nine: $[\sin(\theta/2)\, a,
# \cos(\theta/2)]$ for a turn by $\theta$ about the axis $a$. A quaternion $q$ and $-q$ are the
# same rotation, which every interpolation has to take care of.
#
# **Poses** are rotations together with positions. As matrices they are
#
# $$
# T = \begin{bmatrix} R & t \\ 0 & 1 \end{bmatrix},
# \qquad
# \hat\xi = \begin{bmatrix} \hat\phi & \rho \\ 0 & 0 \end{bmatrix}
# $$ (eq-m-pose)
#
# and the tangent vector $\xi = [\rho, \phi]$ is a *twist*, a velocity and an angular velocity. The
# exponential of a constant twist is where a body is after one second. In the plane the body has
# then driven along an arc of a circle, as a car with a constant speed and a constant turn rate
# does.
#
# **The adjoint.** The same motion can be described in the frame of the body or in the frame of the
# room. If the pose of the body is $T$, a small motion $\xi$ in its own frame is the motion
# $\mathrm{Ad}_T\, \xi$ in the frame of the room:
#
# $$ T \exp(\hat\xi)\, T^{-1} = \exp\bigl(\widehat{\mathrm{Ad}_T\, \xi}\bigr) $$ (eq-m-adjoint)
#
# $\mathrm{Ad}_T$ is a matrix. It is needed wherever motions that were measured in different frames
# are to be added, and a covariance moves from one frame to the other as in {eq}`eq-m-linear`.

# %%
T = lie.se2_exp(torch.tensor([1.0, 0.5, 0.8]))
xi = torch.tensor([0.2, 0.0, 0.1])
in_the_room = lie.se2_adjoint(T) @ xi
left = lie.se2_compose(T, lie.se2_compose(lie.se2_exp(xi), lie.se2_inverse(T)))
print("T exp(xi) T^-1: ", left)
print("exp(Ad_T xi):   ", lie.se2_exp(in_the_room))

# %% tags=["claims"]
claim("adjoint", (left - lie.se2_exp(in_the_room)).abs().max(), below=1e-14)

# %% [markdown]
# ## The implicit function theorem
#
# *Used in chapter [8](08_learning.py), and by every gradient of a plan.*
#
# A plan, a fit or a fixed point is not given by a formula but as the solution of equations. How
# does the solution move when the problem changes? Let $w$ be the unknowns and $\theta$ the
# parameters, and let the solution $w(\theta)$ be defined by as many equations as there are
# unknowns:
#
# $$ g(w(\theta), \theta) = 0 \quad \text{for all } \theta $$ (eq-m-implicit)
#
# The left side is zero for all $\theta$, so its derivative is zero, too. By the chain rule
#
# $$
# \frac{\partial g}{\partial w} \frac{d w}{d \theta} + \frac{\partial g}{\partial \theta} = 0
# $$ (eq-m-chain)
#
# and if $\partial g / \partial w$ can be inverted, this says how the solution moves. The
# {term}`implicit function theorem` adds that under this condition $w(\theta)$ really exists near a
# solution, and is smooth.
#
# **A minimum.** The best $w$ of a cost $J(w, \theta)$ solves $g = \partial J / \partial w = 0$.
# Then $\partial g / \partial w$ is the matrix $H$ of the second derivatives, the Hessian, and
#
# $$
# \frac{d w}{d \theta} = -H^{-1} \frac{\partial^2 J}{\partial w\, \partial \theta}
# $$ (eq-m-minimiser)
#
# It does not matter how the minimum was found. Ten steps of a solver or a thousand, none of
# them has to be differentiated. What matters is that it *was* found: where $g$ is not zero,
# the formula says nothing. <!-- given: ten, a thousand -->
#
# As an example take $J = \tfrac14 w^4 - \theta w$. Its minimum is $w = \sqrt[3]{\theta}$, so that
# we can compare.


# %%
def cost(w, theta):
    return w**4 / 4 - theta * w


theta = torch.tensor(2.0, requires_grad=True)
w = torch.tensor(1.0)
for _ in range(20):  # Newton's method
    w = w - (w**3 - theta.detach()) / (3 * w**2)

w.requires_grad_()
(g,) = torch.autograd.grad(cost(w, theta), w, create_graph=True)
hessian, mixed = torch.autograd.grad(g, [w, theta])
slope = -mixed / hessian
print(f"w = {w.item():.4f}, dw/dtheta = {slope.item():.4f}")

# %% tags=["hide-input"]
thetas = torch.linspace(0.02, 4, 200)
fig, ax = plt.subplots(figsize=(7, 3.4))
ax.plot(thetas, thetas ** (1 / 3), label="the minimum")
at, here = theta.item(), w.item()
near = torch.tensor([0.8, 3.2])
ax.plot(near, here + slope.item() * (near - at), "--", label="by the theorem")
ax.plot(at, here, "ko", label="where it was solved")
ax.set(xlabel="parameter", ylabel="w at the minimum", ylim=(0, 2))
ax.legend(loc="lower right")
plotting.show(
    fig,
    "The minimum as a function of the parameter rises steeply at zero and becomes "
    "flatter. A dashed line touches it where it was solved.",
)

# %% tags=["claims"]
claim("implicit_slope", slope, equals=2 ** (-2 / 3) / 3, within=1e-12)
minimum = [cost(torch.tensor(t ** (1 / 3)), t) for t in (2 - 1e-5, 2 + 1e-5)]
envelope = (minimum[1] - minimum[0]) / 2e-5
claim("envelope", envelope, equals=-here, within=1e-8)

# %% [markdown]
# The curve is infinitely steep at zero. There the Hessian $3 w^2$ is zero, and the condition of the
# theorem does not hold. Such points exist in practice: two plans that are equally good, one to the
# left and one to the right of an obstacle, are an example.
#
# **The least cost** itself is easier to differentiate than the minimum. By the chain rule, its
# derivative is
# $\frac{\partial J}{\partial w} \frac{d w}{d \theta} + \frac{\partial J}{\partial \theta}$, and the
# first term vanishes, since $\partial J / \partial w = 0$ at a minimum:
#
# $$ \frac{d}{d \theta} \min_w J(w, \theta) = \frac{\partial J}{\partial \theta} $$ (eq-m-envelope)
#
# This is the {term}`envelope theorem`. In the example it gives $-w$, and the difference quotient of
# the least cost is {claim}`envelope`.
#
# **Bounds.** If an input stands at its bound and would like to go beyond, it stays there when the
# problem changes a little. It is no longer an unknown but a number that moves with its bound, and
# {eq}`eq-m-minimiser` holds for the others.

# %% [markdown]
# ## Further reading
#
# - Gaussians and their conditioning: {cite:t}`thrun2005`, and {cite:t}`barshalom2001` for tests of
#   consistency.
# - The Schur complement, the Riccati equation and duality: {cite:t}`anderson1990` and
#   {cite:t}`boyd_ee363`.
# - Rotations and poses: {cite:t}`sola2018` is short and complete.
# - Derivatives of solutions: {cite:t}`blondel2022`, and {cite:t}`amos2018` for plans.
