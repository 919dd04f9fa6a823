"""The pass that makes small matrices entries: the graph that it leaves, run in Python."""

import pytest
import torch
from oracles import draw
from torch._higher_order_ops.scan import scan
from torch._inductor.decomposition import select_decomp_table
from torch._subclasses import FakeTensorMode
from torch.func import functionalize
from torch.fx.experimental.proxy_tensor import make_fx
from torch.fx.experimental.symbolic_shapes import DimDynamic, ShapeEnv, StatelessSymbolicContext

from pypose_lite import batched, entries

pytestmark = pytest.mark.usefixtures("float64")

B, OTHER = 7, 11  # only batches are of these sizes, which a graph knows as symbols
TABLE = select_decomp_table()
MOVES = """as_strided cat expand full iota permute reshape scalar_tensor select sym_size
unsqueeze""".split()


@pytest.fixture
def compiling(monkeypatch):
    monkeypatch.setattr(torch.compiler, "is_compiling", lambda: True)


def traced(f, *zs):
    """Returns a function as the graph that inductor would get."""
    mode = FakeTensorMode(shape_env=ShapeEnv())

    def fake(z):
        dims = [DimDynamic.DUCK if s in (B, OTHER) else DimDynamic.STATIC for s in z.shape]
        return mode.from_tensor(z, symbolic_context=StatelessSymbolicContext(dynamic_sizes=dims))

    fakes = [fake(z) for z in zs]
    with mode:
        module = make_fx(functionalize(f), TABLE)(*fakes)
    module.graph.eliminate_dead_code()
    return module


def arguments(g, shapes, size=B, dtype=torch.float64):
    return [draw(g, *(size if s == B else s for s in shape), dtype=dtype) for shape in shapes]


def rewritten(f, g, *shapes, dtype=torch.float64):
    """Returns a function's graph after the pass, having held it to the function."""
    module = traced(f, *arguments(g, shapes, dtype=dtype))
    entries.Entries()(module.graph)
    module.graph.lint()
    module.recompile()
    for size in (B, 5, 2, 1):
        zs = arguments(g, shapes, size, dtype)
        torch.testing.assert_close(module(*zs), f(*zs))
    return module.graph


def is_left_alone(f, g, *shapes):
    return str(traced(f, *arguments(g, shapes)).graph) == str(rewritten(f, g, *shapes))


def work(graph):
    """Returns what a graph computes: nodes and the names of their operations."""
    calls = [(n, n.target.__name__.split(".")[0]) for n in graph.nodes if n.op == "call_function"]
    return [(n, name) for n, name in calls if name not in MOVES]


def names(graph):
    return [name for _, name in work(graph)]


def is_of_entries(graph):
    """Returns whether all arithmetic is of single entries, and nothing else is left."""
    return all(n.meta["val"].ndim == 1 for n, _ in work(graph))


# What becomes entries


def assigned(x, y):
    x = x.clone()
    x[..., 0, :] = y[..., 1, :]
    x[..., 1:] = 2 * y[..., :2]
    return x


OF_TWO = {  # of x and y, (2, 3) each, or rows (2, 3, B)
    "expand": lambda x, y: x[:, :1].expand(x.shape) + y[1],
    "cat": lambda x, y: torch.cat([x, y * y, x]),
    "stack": lambda x, y: torch.stack([x, y + 1, x], 1),
    "select": lambda x, y: x[-1] * y[0],
    "slice": lambda x, y: x[:, ::2] - y[:, :2],
    "permute": lambda x, y: (x.movedim(0, 1), y.movedim(1, 0) + 1),
    "unbind": lambda x, y: [a * b for a, b in zip(x.unbind(1), y.unbind(1))],
    "split": lambda x, y: [2 * z for z in (*x.split(2, 1), *y.split([1, 2], 1))],
    "squeeze": lambda x, y: x[:, :1].squeeze(1) + y[:1, :1].squeeze((0, 1)).unsqueeze(0),
    "reshape": lambda x, y: x.flatten(0, 1).unflatten(0, (3, 2)) + y.reshape(3, 2, *y.shape[2:]),
    "choice": lambda x, y: torch.where(x > y, x, 2 * y),
    "clamp": lambda x, y: (x.clamp(max=y), x.clamp(min=y), x.clamp(-y.abs(), y.abs())),
    "compare": lambda x, y: (x < y, (x > 0) & ~(y >= x), (x <= y).to(torch.int32) + 1),
    "extremes": lambda x, y: (x.amax(1), y.amin((1, 0), keepdim=True), (x > y).int().amax(0)),
    "sums": lambda x, y: (x.sum(1), (x - y).sum((0, 1)), y.sum(0, keepdim=True)),
    "functions": lambda x, y: torch.sin(x) / (2 + y.cos()) ** 2 - torch.atan2(x, y),
    "index": lambda x, y: x[:, 2 - torch.arange(3)] + y[torch.arange(2), torch.arange(2)][:, None],
    "twice": lambda x, y: (x * y, x, x * y),
}
OF_MATRICES = {  # of x and y, (2, 3) each, or (B, 2, 3)
    "matrix product": lambda x, y: batched.bmm(x, y.mT),
    "matrix and vector": lambda x, y: batched.bmv(x, y[..., 0, :]),
    "vectors": lambda x, y: batched.bvv(x, y),
    "cat of matrices": lambda x, y: batched.cat([x, 2 * y], -2),
    "assignment": assigned,
    "rows": lambda x, y: batched.to_rows(x, 0) * y.movedim(0, -1),
}


WITH_OR_WITHOUT = pytest.mark.parametrize("batch", [(B,), ()], ids=["batch", "lanes"])


@WITH_OR_WITHOUT
@pytest.mark.parametrize("name", OF_TWO)
def test_rows_become_entries(g, name, batch):
    assert is_of_entries(rewritten(OF_TWO[name], g, (2, 3, *batch), (2, 3, *batch)))


@WITH_OR_WITHOUT
@pytest.mark.parametrize("name", OF_MATRICES)
def test_products_become_entries(g, compiling, name, batch):
    assert is_of_entries(rewritten(OF_MATRICES[name], g, (*batch, 2, 3), (*batch, 2, 3)))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=str)
@WITH_OR_WITHOUT
def test_solves_become_entries(g, compiling, batch, dtype):
    def solve(A, R):
        return batched.solve_positive(batched.bmm(A, A.mT) + torch.eye(2, dtype=dtype), R)

    shapes = (*batch, 2, 2), (*batch, 2, 1)
    assert is_of_entries(rewritten(solve, g, *shapes, dtype=dtype))


# What is known


def column(value, dtype=torch.float64):
    return torch.full((2, 1), value, dtype=dtype)


KNOWN = {  # of x, (2, B), and what is left to compute
    "I x": (lambda x: (torch.eye(2)[..., None] * x).sum(1), ""),
    "0 x": (lambda x: (torch.zeros(2, 2, 1) * x).sum(1), ""),
    "swap": (lambda x: ((1 - torch.eye(2))[..., None] * x).sum(1), ""),
    "times 1": (lambda x: (column(1) * x, x * column(1), x / column(1)), ""),
    "times 0": (lambda x: (column(0) * x, x * column(0), column(0) / x), ""),
    "plus 0": (lambda x: (column(0) + x, x + column(0), x - column(0)), ""),
    "0 - x": (lambda x: column(0) - x, "sub sub"),
    "1 / x": (lambda x: column(1) / x, "div div"),
    "x / 0": (lambda x: x / column(0), "div div"),
    "0 + 2 x": (lambda x: torch.add(column(0), x, alpha=2), "add add"),
    "others": (lambda x: column(2) * x + column(1), "mul mul add add"),
    "true": (lambda x: torch.where(column(1) > 0, x, 2 * x), ""),
    "false": (lambda x: torch.where(column(0) > 0, 2 * x, x), ""),
    "both": (lambda x: torch.where(torch.eye(2)[..., None] > 0, x, column(3)), ""),
    "constants": (lambda x: (column(2) + column(3) + torch.zeros_like(x)).sqrt(), ""),
    "same type": (
        lambda x: column(1, torch.int32) * x.int(),
        TO_INT := "convert_element_type " * 2,
    ),
    "other type": (lambda x: column(1) * x.int(), TO_INT + "mul mul"),
    "types": (lambda x: [z.expand(x.shape) for z in (column(1), column(1, torch.float32))], ""),
    "0-dim": (
        lambda x: x.float() * (column(2, torch.float32) * torch.full((), 3.0)),
        "convert_element_type " * 2 + "mul mul",
    ),
    "again": (lambda x: x * x + x * x, "mul mul add add"),
}


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_known_is_not_computed(g, name):
    f, left = KNOWN[name]
    graph = rewritten(f, g, (2, B))
    assert names(graph) == left.split()


# Without a batch


@pytest.mark.parametrize(
    "f",
    [
        lambda x, y: (x * 2, y.sum(1), x[:1, 0] + 1),
        lambda x, y: x.sum((0, 1)),
        lambda x, y: (x, x[0, 1], y[1, :, None]),
        lambda x, y: (x[:1, 1].expand(3), torch.zeros(2, 2), column(2)),
        lambda x, y: (x > y, (x > y).int() + torch.arange(3), torch.arange(4)),
        lambda x, y: (x[:, 0] > 0, x * y, x * y),
    ],
    ids=["sizes", "number", "passed on", "equal or constant", "types", "twice"],
)
def test_results_without_a_batch_are_picked_by_lane(g, f):
    graph = rewritten(f, g, (2, 3), (2, 3))
    assert is_of_entries(graph) and "as_strided" in str(graph) and "cat" not in str(graph)


# What it does not know, or must not do


@WITH_OR_WITHOUT
@pytest.mark.parametrize(
    "f, name",
    [
        (lambda M: (M * 2).cumsum(-1) + M, "cumsum"),
        (lambda M: (2 * M).flip(-1) + M, "rev"),
        (lambda M: torch.linalg.cholesky_ex(M @ M.mT).L + M, "linalg_cholesky_ex"),
    ],
    ids=["cumsum", "flip", "cholesky"],
)
def test_what_is_not_known_is_kept(g, f, name, batch):
    assert name in names(rewritten(f, g, (*batch, 2, 2)))


ACROSS = {  # the batch, or types, of x, (4, B)
    "sum": lambda x: 2 * x - x.sum(1, keepdim=True),
    "sum of all": lambda x: 2 * x - x.sum((0, 1)) - x.sum(()),
    "maximum": lambda x: 2 * x - x.amax(-1, keepdim=True),
    "select": lambda x: 2 * x - x[:, 0, None],
    "slice": lambda x: 2 * x - x[:, :1],
    "slice as long": lambda x: torch.cat([x[:, 1:], x[:, :1]], 1),
    "index": lambda x: 2 * x - x[:, torch.zeros(1, dtype=torch.int64)],
    "computed index": lambda x: 2 * x[:, (x[0] > 0).long()],
    "gather": lambda x: 2 * x.gather(0, (x > 0).long()),
    "view": lambda x: 2 * x.view(x.shape[1], 4).sum(1),
    "view and back": lambda x: 2 * x.view(x.shape[1], 4).mT - x,
    "flip": lambda x: 2 * x - x.flip(1),
    "size": lambda x: x + x.shape[1],
    "copy": lambda x: 2 * x.float(),
    "cat of types": lambda x: torch.cat([x, x > 0]),
    "sum of bools": lambda x: (x > 0).sum(0),
    "sum to a type": lambda x: 2 * x.sum(0, dtype=torch.float32),
}


@pytest.mark.parametrize("name", ACROSS)
def test_members_and_types_stay_apart(g, name):
    rewritten(ACROSS[name], g, (4, B))


@WITH_OR_WITHOUT
def test_a_computed_index_picks_what_it_says(g, batch):
    rewritten(lambda table, x: table[(x > 0).long()] + x, g, (2,), (3, *batch))


@pytest.mark.parametrize(
    "f",
    [lambda x: (x + 1, torch.ones(3)), lambda x: (x + 1, x.sum(1)), lambda x: torch.cat([x, x], 1)],
    ids=["constant result", "sum as result", "twice the batch"],
)
def test_a_graph_with_other_than_members_is_left_alone(g, f):
    assert is_left_alone(f, g, (3, B))


@pytest.mark.parametrize("largest, alone", [(5, True), (6, False)])
def test_a_graph_of_large_tensors_is_left_alone(g, monkeypatch, largest, alone):
    monkeypatch.setattr(entries, "LARGEST", largest)
    for shape in [(2, 3, B), (6,)]:
        assert is_left_alone(lambda x: 2 * x, g, shape) == alone


def test_a_graph_with_a_loop_is_left_alone(g):
    def either(x):
        return 2 * torch.cond(x.sum() > 0, lambda z: 2 * z, lambda z: z - 1, (x,))

    assert is_left_alone(either, g, (3,))


@pytest.mark.parametrize("reads", [(0, 1), (1,), ()])
def test_a_loop_loses_the_sequences_that_it_does_not_read(g, reads):
    def total(x, *ys):
        def step(x, at):
            return x + sum(at[i] for i in reads), 2 * x

        return scan(step, x, ys)

    graph = rewritten(total, g, (2,), (3, 2), (3, 2))
    (loop,) = graph.find_nodes(op="call_function", target=torch.ops.higher_order.scan)
    assert len(loop.args[2]) == max(1, len(reads))


@WITH_OR_WITHOUT
def test_random_numbers_stay_different(g, batch):
    module = traced(lambda x: torch.rand_like(x) - torch.rand_like(x), draw(g, 3, *batch))
    before = str(module.graph)
    entries.Entries()(module.graph)
    assert str(module.graph) == before
    assert (module(draw(g, 3, *batch)) != 0).all()


UNLIKE_ITSELF = {
    "number of the member": (lambda x: x + torch.arange(x.shape[1]), (3, B)),
    "roll": (lambda x: x.roll(1, 1), (3, B)),
    "size as a constant": (lambda x: x + torch.full((3, 1), x.shape[1]), (3, B)),
    "0-dim of another type": (lambda x: x.float() * torch.full((), 0.5), (3, B)),
    "maximum of all": (lambda x: x + x.amax(), (3, B)),
    "sum of None": (lambda x: x + x.sum(None, keepdim=True), (3, B)),
    "sum of nothing": (lambda x: x.sum(0), (0, B)),
    "nothing": (lambda x: (2 * x, 2 * x[:0]), (3, B)),
    "pair": (lambda x: torch.frexp(x)[0], (3, B)),
    "unknown and large": (lambda x: (x > 1).any(1), (2, 3)),
    "no tensors": (lambda x: x.shape[0], (B,)),
}


@pytest.mark.parametrize("name", UNLIKE_ITSELF)
def test_what_is_not_arithmetic_of_entries_is_right_all_the_same(g, name):
    rewritten(UNLIKE_ITSELF[name][0], g, UNLIKE_ITSELF[name][1])


def test_two_batches_are_left_alone(g):
    assert is_left_alone(lambda x, y: (2 * x, 2 * y), g, (3, B), (3, OTHER))
