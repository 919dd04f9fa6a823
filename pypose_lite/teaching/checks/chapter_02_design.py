"""What the answers of lab 2 must do: a pole on a cart, a test, a driver, a dog."""

import torch

from ... import go1
from ...control import dlqr
from ...systems import CartPole
from . import expect
from .chapter_02 import by_least_squares
from .exercise import Exercise, Failure

cart = Exercise("2.5", "A pole on a cart", minutes=15, points=2)


def carried(weights):
    """States and forces of 6 s in which the cart is to come from x = 1 m to 0."""
    weights = expect.tensor("the weights", weights, (5,)).detach()
    system, x = CartPole(0.02), torch.tensor([1.0, 0.0, 0.0, 0.0])
    A, B = system.linearize(torch.zeros(4), torch.zeros(1))[:2]
    try:
        K, _ = dlqr(A, B, torch.diag(weights[:4]), weights[4:, None])
    except ValueError as error:
        raise Failure("weights for which there is a gain", f"dlqr's error: {error}") from None
    states, forces = [x], []
    for _ in range(300):
        forces.append(-K @ states[-1])
        states.append(system.transition(states[-1], forces[-1]))
    return torch.stack(states), torch.stack(forces)[:, 0]


@cart.must("be five weights, of [x, dx, theta, dtheta, F]: none negative, that of F positive")
def weights_of_cart(answer, given):
    weights = expect.tensor("the weights", answer, (5,))
    hint = "A negative weight rewards what it should punish."
    expect.that((weights >= 0).all(), "no negative weight", f"{weights.min():g}", hint)
    hint = "A force that costs nothing has no best size."
    expect.that(weights[4] > 0, "a positive weight of F", f"{weights[4]:g}", hint)


@cart.must("keep the force below 5 N")
def force(answer, given):
    most = carried(answer)[1].abs().max().item()
    hint = "Raise the weight of F, or lower the others: only their ratios count."
    expect.that(most < 5, "at most 5 N", f"{most:.2f} N", hint)


@cart.must("keep the pole within 0.1 rad of upright")
def pole(answer, given):
    most = carried(answer)[0][:, 2].abs().max().item()
    hint = "The cart hurries. Raise the weights of the angle or of the two rates."
    expect.that(most < 0.1, "at most 0.1 rad", f"{most:.3f} rad", hint)


@cart.must("be within 5 cm of 0 from 2.5 s on")
def arrived(answer, given):
    offset = carried(answer)[0][125:, 0]
    late = offset[offset.abs().argmax()].item()
    hint = "It is slow: what does it cost to be away from 0, beside all other prices?"
    if late < 0:
        hint = "It overshoots: what does it cost to be fast?"
    expect.that(abs(late) < 0.05, "at most 0.05 m", f"{late:.3f} m", hint)


suspects = Exercise(
    "2.6", "A test for an LQR", minutes=15, takes="lqr", points=3, random=True, seconds=30
)


def recursion(fault=""):
    """An LQR with a fault: a function of A, B, Q, R, T that returns K (T, m, n)."""

    def lqr(A, B, Q, R, T):
        n, m = A.shape[-1], B.shape[-1]
        Q = torch.diag(Q.diagonal()) if fault == "diagonal Q" else Q
        R = R[0, 0] * torch.eye(m, dtype=R.dtype) if fault == "one R" else R
        V = Q if fault == "begins with Q" else torch.zeros(n, n, dtype=A.dtype)
        gains = []
        for _ in range(T):
            after = A.mT if fault == "A in K" else A
            H = R + B.mT @ V @ B
            K = -torch.linalg.solve(H, B.mT @ V @ after)
            before = Q + A.mT @ V @ (A + B @ K)
            if fault == "A in V":
                before = Q + A @ V @ (A + B @ K)
            if fault == "V of no input":
                before = Q + A.mT @ V @ A
            V = (before + before.mT) / 2
            gains.append(-K if fault == "sign" else K)
        return torch.stack(gains if fault == "order" else gains[::-1])

    return lqr


def dense(A, B, Q, R, T):
    """A right LQR by another way, whose last digits are others."""
    V = 1e-14 * torch.eye(len(A), dtype=A.dtype)
    gains = list[torch.Tensor]()
    for _ in range(T):
        V, K = by_least_squares(A, B, Q, R, V)
        gains.insert(0, K)
    return torch.stack(gains)


FAULTS = {
    "sign": ("gains with the wrong sign", "Which input costs less: K x, or none at all?"),
    "A in K": ("A transposed in the gain", "Does your A differ from its transpose?"),
    "A in V": ("A transposed in the cost-to-go", "It shows after three steps, and if A is not A'."),
    "V of no input": ("a cost-to-go without input", "It shows after three steps."),
    "order": ("the last gain first", "Is each gain used in its own step, more than one of them?"),
    "begins with Q": ("V = Q at the end, not 0", "It shows in the last gain, which should be 0."),
    "one R": ("R taken as a number", "Is your R a matrix with more than one number?"),
    "diagonal Q": ("Q without its other entries", "Is your Q a diagonal matrix?"),
}


def verdict_is(answer, lqr, right, case, hint):
    """Sees to what the test says of an LQR."""
    came = answer(lqr)
    is_bool = isinstance(came, bool) or (hasattr(came, "dtype") and came.shape == ())
    expect.that(is_bool and came in (0, 1), "True or False", expect.kind(came))
    expect.that(bool(came) is right, f"{right} for {case}", f"{bool(came)}", hint)


@suspects.must("say True of a right LQR")
def accepts(answer, given):
    hint = "Rounding differs from one way to another: compare with a tolerance."
    verdict_is(answer, recursion(), True, "the recursion of the chapter", hint)
    verdict_is(answer, dense, True, "a right one that computes by another way", hint)


@suspects.must("say False of an LQR with a fault, whichever it is")
def refuses(answer, given):
    for fault, (case, hint) in FAULTS.items():
        verdict_is(answer, recursion(fault), False, case, hint)


driver = Exercise(
    "2.7", "What a driver wants", minutes=20, takes="states, A, B, Q", points=3, seconds=120
)


def recorded(given, weight):
    """A, B and Q of a car beside a line, and the states of a driver, seen with noise."""
    A, B = torch.tensor([[1.0, 0.1], [0.0, 1.0]]), torch.tensor([[0.01], [0.1]])
    Q, x = torch.diag(torch.tensor([1.0, 0.1])), torch.tensor([0.5, 0.0])
    K, _ = dlqr(A, B, Q, torch.tensor([[weight]]))
    states = [x]
    for _ in range(50):
        states.append((A - B @ K) @ states[-1])
    return torch.stack(states) + 0.002 * given.randn(51, 2), A, B, Q


@driver.must("return one positive number")
def one_number(answer, given):
    came = expect.tensor("the weight", answer(*recorded(given, 0.3)), ())
    hint = "Learn the logarithm of the weight: its exponential is positive."
    expect.that(came > 0, "a positive weight", expect.kind(float(came)), hint)


@driver.must("find the weight, to within 10 %, whatever it is")
def finds(answer, given):
    for weight in (0.05, 2.0):
        mistakes = {
            "This is a first guess that has not moved: is the gradient used?": 1.0,
            "This is 1 / weight.": 1 / weight,
            "This is the square root of the weight.": weight**0.5,
        }
        hint = "Plot the loss: does it fall, and has it come to rest? Try smaller or more steps."
        came = answer(*recorded(given, weight))
        expect.close("the weight", came, weight, hint, mistakes, tolerance=0.1)


dog = Exercise("2.8", "The dog walks to a line", minutes=10, points=2, seconds=60)


def two_numbers(gain):
    """The gain as a vector, also where it comes as a matrix, as dlqr returns it."""
    gain = expect.tensor("the gain", gain).detach()
    return expect.tensor("the gain", gain[0] if gain.shape == (1, 2) else gain, (2,))


def walked(gain):
    """Offsets from the line, headings and turn rates of the simulated Go1, 8 s long."""
    gain = two_numbers(gain)
    offsets, rates = [], []
    with go1.connect("sim") as robot:
        for _ in range(80):
            ahead, left, heading = robot.pose()
            offsets.append(left - 0.5)
            rates.append(gain[0].item() * offsets[-1] + gain[1].item() * heading)
            robot.move(0.5, rates[-1])
            robot.wait(0.1)
    return torch.tensor(offsets), torch.tensor(rates)


@dog.must("be a gain of two numbers, of the offset and of the heading, that turn to the line")
def gain_of_dog(answer, given):
    gain = two_numbers(answer)
    hint = "The turn rate is K x: left of the line it has to turn right."
    expect.that((gain < 0).all(), "two negative numbers", f"{gain.tolist()}", hint)


@dog.must("ask for no more than the 1.5 rad/s that the legs can do")
def legs(answer, given):
    most = walked(answer)[1].abs().max().item()
    hint = "At the start the dog is 0.5 m from the line and looks ahead."
    expect.that(most <= 1.5, "at most 1.5 rad/s", f"{most:.2f} rad/s", hint)


@dog.must("cross the line by no more than 1 cm")
def crosses(answer, given):
    most = walked(answer)[0].max().item()
    hint = "The heading counts too little beside the offset: the dog turns back too late."
    expect.that(most <= 0.01, "at most 0.01 m", f"{most:.3f} m", hint)


@dog.must("be within 2 cm of the line from 5 s on")
def on_the_line(answer, given):
    most = walked(answer)[0][50:].abs().max().item()
    hint = "It is slow: the offset counts too little, or the heading too much."
    expect.that(most <= 0.02, "at most 0.02 m", f"{most:.3f} m", hint)
