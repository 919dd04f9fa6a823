"""Passes for torch's compiler: small matrices become their entries, numbers that stay in registers.

To the compiler a product of two matrices is a loop that writes its result to memory before the
next product reads it. As entries it is plain arithmetic, all steps of which are one loop over the
batch; and what is known to be 0 or 1, as much of a Jacobian is, costs nothing. The pass rewrites
what a loop over time repeats: there all dimensions are small but that of the batch.

While it does, a tensor is an array of labels, one for each entry, as if the batch had one member.
What only moves entries, such as ``cat``, is done to the labels; arithmetic makes new entries.
"""

import itertools
import math
import operator
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch._inductor.custom_graph_pass import (
    CustomGraphPass,
    CustomSchedulerPass,
    get_hash_for_files,
)
from torch._inductor.virtualized import V
from torch.fx import Graph, Node, map_arg

aten, prims = torch.ops.aten, torch.ops.prims
LARGEST = 512  # entries of a tensor; a graph with a larger one stays as it is
CONSTANTS = {aten.full.default: 1, prims.iota.default: 0}  # from which argument on it must be known
UNKNOWN = {torch.Tag.nondeterministic_seeded, torch.Tag.dynamic_output_shape}
MOVES = {  # what only moves entries, and which argument says along what dimensions
    aten.alias.default: None,
    aten.cat.default: 1,
    aten.clone.default: None,
    aten.copy.default: None,
    aten.expand.default: None,
    aten.permute.default: None,
    aten.reshape.default: None,
    aten.select.int: 1,
    aten.select_scatter.default: 2,
    aten.slice.Tensor: 1,
    aten.slice_scatter.default: 2,
    aten.split.Tensor: 2,
    aten.split_with_sizes.default: 2,
    aten.squeeze.dim: 1,
    aten.squeeze.dims: 1,
    aten.unbind.int: 1,
    aten.unsqueeze.default: None,
    aten.view.default: None,
    operator.getitem: None,
}
FOLDS = {
    aten.sum.dim_IntList: aten.add.Tensor,
    aten.amax.default: aten.maximum.default,
    aten.amin.default: aten.minimum.default,
}


class Entries(CustomGraphPass):
    """Rewrites graphs without loops of their own, if their tensors are small.

    Loops of other graphs lose what their bodies do not use, such as a time that changes nothing.
    """

    def __call__(self, graph: Graph) -> None:
        """Changes the graph to one of entries, or but its loops over time."""
        loops = [n for n in graph.nodes if isinstance(n.target, torch._ops.HigherOrderOperator)]
        for node in loops:
            if node.target is torch.ops.higher_order.scan:
                _without_unused(node, graph.owning_module)
        vals = [z for node in graph.nodes for z in _tensors(node)]
        if loops or not vals or not _are_small(vals):
            return
        try:
            _Rewriting(graph, vals[0]).run()
        except _Unknown:  # what it has made so far is used by nothing
            pass
        graph.eliminate_dead_code()

    def uuid(self) -> bytes:
        """Returns what compiled code is kept under: it changes with this file."""
        return get_hash_for_files((__file__,))


class Unallocated(CustomSchedulerPass):
    """Lets loops do without memory for what a kernel keeps to itself, as other code does.

    The code that allocates asks the outer graph what that is, and a loop's body keeps its own list.
    """

    def __call__(self, nodes: list) -> list:
        """Returns the nodes as they are."""
        parent = getattr(V.graph, "parent", None)
        if parent is not None:
            parent.removed_buffers |= V.graph.removed_buffers
            V.graph.removed_buffers = parent.removed_buffers
        return nodes

    def uuid(self) -> bytes:
        """Returns what compiled code is kept under: it changes with this file."""
        return get_hash_for_files((__file__,))


def _without_unused(node: Any, module: Any) -> None:
    """Takes sequences from a loop over time that its body does not read, but never all."""
    body, carry, sequences, rest = node.args
    graph = getattr(module, body.target).graph
    steps = graph.find_nodes(op="placeholder")[len(carry) :][: len(sequences)]
    read = [i for i, step in enumerate(steps) if step.users] or [0]
    for i, step in enumerate(steps):
        if i not in read:
            graph.erase_node(step)
    node.args = body, carry, [sequences[i] for i in read], rest
    getattr(module, body.target).recompile()


class _Unknown(Exception):
    """What cannot be done to entries."""


class _Rewriting:
    """A graph, and what is known of it.

    An entry is a node with a number for each member of the batch or, where there is no batch, for
    each *lane*: the same number, as many times as the largest result has entries. So a lane can
    pick one entry, and all of a result is a single vector. Or it is a constant.
    """

    def __init__(self, graph: Any, val: Any):
        self.graph, self.mode, self.device = graph, val.fake_mode, val.device
        self.entries: list[Any] = []
        self.label_of: dict[Any, int] = {}  # of an entry
        self.labels: dict[Any, Any] = {}  # of a tensor's entries
        self.made: dict[str, Any] = {}
        self.batched = [n for n in graph.nodes if n.op == "placeholder" and _batch(n.meta["val"])]
        results = [n.meta["val"] for n in graph.output_node().all_input_nodes]
        self.lanes = max((z.numel() for z in results if isinstance(z, Tensor)), default=0)
        if self.batched:
            self.lanes = 0

    def run(self) -> None:
        start = next(n for n in self.graph.nodes if n.op != "placeholder")
        for node in list(self.graph.nodes):
            before = {"placeholder": start, "get_attr": node.next}.get(node.op, node)
            with self.graph.inserting_before(before):
                if node.op == "output":
                    node.args = map_arg(node.args, self.put_together)
                elif _tensors(node):
                    self.labels[node] = self.rewrite(node)

    def rewrite(self, node: Any) -> Any:
        """Returns the labels of a node's entries."""
        op, args, kwargs = node.target, node.args, node.kwargs
        if node.op in ("placeholder", "get_attr"):
            return self.take_apart(node)
        if op in CONSTANTS and not any(isinstance(z, Node) for z in args[CONSTANTS[op] :]):
            return self.constants(op(*map_arg(args, self.one), **kwargs))
        if op in MOVES and self.keeps_batch(node, MOVES[op]):
            return op(*map_arg(args, self.one), **map_arg(kwargs, self.one))
        if op in FOLDS and self.keeps_batch(node, 1):
            return self.folded(FOLDS[op], node)
        if op is aten.index.Tensor and self.picks_constantly(node):
            return self.labels[args[0]][tuple(map(self.values, args[1]))]
        tags = getattr(op, "tags", UNKNOWN)
        if not UNKNOWN.isdisjoint(tags):
            raise _Unknown
        if torch.Tag.pointwise in tags and isinstance(node.meta["val"], Tensor):
            return self.pointwise(node)
        args, kwargs = map_arg((args, kwargs), self.put_together)
        return self.take_apart(self.call(op, args, kwargs))

    # Each kind of operation

    def pointwise(self, node: Any) -> Tensor:
        """Returns labels of what is made of each choice of entries."""
        given = [n for n in node.all_input_nodes if n in self.labels]
        rows = torch.broadcast_tensors(*(self.labels[n] for n in given))
        flat = []
        for row in zip(*(r.flatten().tolist() for r in rows)):
            entry = {n: self.entries[i] for n, i in zip(given, row)}
            args, kwargs = _replaced((node.args, node.kwargs), entry)
            flat.append(self.compute(node.target, args, kwargs, node.meta["val"].dtype))
        return torch.tensor(flat, dtype=torch.int64).reshape(rows[0].shape)

    def folded(self, op: Callable, node: Any) -> Tensor:
        """Returns labels of sums, or extremes, along some dimensions."""
        labels, val = self.labels[node.args[0]], node.meta["val"]
        along = [d % labels.ndim for d in _dims(node, 1) or range(labels.ndim)]
        rest = [d for d in range(labels.ndim) if d not in along]
        rows = labels.permute(*rest, *along).reshape(-1, math.prod(labels.shape[d] for d in along))
        flat = []
        for total, *others in rows.tolist():
            for other in others:
                args = self.entries[total], self.entries[other]
                total = self.compute(op, args, {}, val.dtype)
            flat.append(total)
        return torch.tensor(flat, dtype=torch.int64).reshape(_one(val.shape))

    def compute(self, op: Any, args: tuple, kwargs: dict, dtype: torch.dtype) -> int:
        """Returns the label of ``op(*args)``; what is known is not computed."""
        if not any(isinstance(z, Node) for z in (*args, *kwargs.values())):
            return self.label(op(*args, **kwargs).to(dtype))
        known = None if kwargs else _known(op, *args)
        if known is not None and _dtype(known) == dtype:
            return self.label(known)
        args, kwargs = torch.utils._pytree.tree_map_only(Tensor, self.node, (tuple(args), kwargs))
        made = self.call(op, args, kwargs)
        if _dtype(made) != dtype:  # a number without dimensions had no say in it
            made = self.call(prims.convert_element_type.default, (made, dtype))
        return self.label(made)

    def constants(self, z: Tensor) -> Tensor:
        flat = [self.label(value) for value in z.flatten().unbind()]
        return torch.tensor(flat, dtype=torch.int64).reshape(z.shape)

    # From tensors to entries, and back

    def take_apart(self, node: Any) -> Tensor:
        """Returns labels of new entries, each selected from a node."""
        val = node.meta["val"]
        if not isinstance(val, Tensor):
            raise _Unknown
        fixed = [d for d, size in enumerate(val.shape) if isinstance(size, int)]
        flat = []
        for index in itertools.product(*(range(val.shape[d]) for d in fixed)):
            entry = node
            for d, i in reversed(list(zip(fixed, index))):
                entry = self.call(aten.select.int, (entry, d, i))
            flat.append(self.label(self.call(aten.expand.default, (entry, self.size()))))
        return torch.tensor(flat, dtype=torch.int64).reshape(_one(val.shape))

    def put_together(self, node: Any) -> Any:
        """Returns a node that has all entries of a tensor again."""
        if node not in self.labels or node.op == "placeholder":
            return node
        labels, val = self.labels[node].flatten().tolist(), node.meta["val"]
        batch, fixed = _batch(val), [s for s in val.shape if isinstance(s, int)]
        if self.batched and not batch:
            raise _Unknown
        if 0 < len(labels) <= self.lanes:
            strides = [math.prod(fixed[d + 1 :]) for d in range(len(fixed))]
            return self.call(aten.as_strided.default, (self.by_lane(labels), fixed, strides))
        rows = [self.call(aten.unsqueeze.default, (self.node(self.entries[i]), 0)) for i in labels]
        whole = self.call(aten.cat.default, (rows, 0))
        if self.lanes:
            whole = self.call(aten.select.int, (whole, 1, 0))
        whole = self.call(aten.reshape.default, (whole, [*fixed, *(self.size() if batch else [])]))
        order = list(range(len(fixed)))
        for d in batch:
            order.insert(d, len(fixed))
        return self.call(aten.permute.default, (whole, order))

    def by_lane(self, labels: list[int]) -> Any:
        """Returns a vector that has in each lane another entry."""
        iota = {"start": 0, "step": 1, "dtype": torch.int64, "device": self.device}
        lane = self.call(prims.iota.default, (self.lanes,), {**iota, "requires_grad": False})

        def pick(low: int, high: int) -> Any:
            if high - low == 1:
                return self.node(self.entries[labels[low]])
            middle = (low + high) // 2
            left = self.call(aten.lt.Scalar, (lane, middle))
            return self.call(aten.where.self, (left, pick(low, middle), pick(middle, high)))

        one = pick(0, len(labels))
        mask = self.call(aten.lt.Scalar, (lane, len(labels)))
        return self.call(aten.where.self, (mask, one, one)) if len(labels) == 1 else one

    # Nodes and labels

    def call(self, op: Any, args: tuple, kwargs: dict | None = None) -> Any:
        """Returns a new node, or an old one that is the same."""
        kwargs = kwargs or {}
        key = str((op, args, kwargs))
        if key not in self.made:
            node = self.graph.call_function(op, args, kwargs)
            with self.mode:
                given, named = map_arg((args, kwargs), lambda n: n.meta["val"])
                node.meta["val"] = op(*given, **named)
            self.made[key] = node
        return self.made[key]

    def node(self, entry: Node | Tensor) -> Any:
        if isinstance(entry, Node):
            return entry
        kwargs = {"dtype": entry.dtype, "device": self.device}
        return self.call(aten.full.default, (self.size(), entry.item()), kwargs)

    def size(self) -> list[Any]:
        """Returns the shape of an entry."""
        if not self.batched:
            return [self.lanes]
        one = self.batched[0]
        return [self.call(aten.sym_size.int, (one, _batch(one.meta["val"])[0]))]

    def label(self, entry: Node | Tensor) -> int:
        key = (str(entry.item()), entry.dtype) if isinstance(entry, Tensor) else entry
        if key not in self.label_of:
            self.label_of[key] = len(self.entries)
            self.entries.append(entry)
        return self.label_of[key]

    def one(self, node: Any) -> Any:
        """Returns a node's labels, or a size, as if the batch had one member."""
        return self.labels[node] if node in self.labels else _one([node.meta["val"]])[0]

    def values(self, node: Any) -> Any:
        """Returns the constants that an index consists of."""
        if node is None:
            return slice(None)
        flat = [self.entries[i] for i in self.labels[node].flatten().tolist()]
        return torch.stack(flat).reshape(self.labels[node].shape)

    # What can be done

    def keeps_batch(self, node: Any, position: int | None) -> bool:
        """Returns whether only entries of a member are moved or folded, all of one type."""
        if node.target is operator.getitem:
            return True
        results = node.meta["val"] if isinstance(node.meta["val"], list | tuple) else _tensors(node)
        vals = [z for n in node.all_input_nodes for z in _tensors(n)] + list(results)
        if any(z.dtype != vals[0].dtype for z in vals) or (node.target in FOLDS and node.kwargs):
            return False
        if node.target in (aten.view.default, aten.reshape.default):
            return len({_before_batch(z) for z in vals}) == 1
        dims = [] if position is None else _dims(node, position)
        if node.target in FOLDS and not dims:
            return not _batch(vals[0])
        return all(isinstance(vals[0].shape[d], int) for d in dims)

    def picks_constantly(self, node: Any) -> bool:
        """Returns whether an index is constant, and each member keeps its own entries."""
        z, indices = node.args
        for d, index in enumerate(indices):
            if index is not None:
                chosen = (self.entries[i] for i in self.labels[index].flatten().tolist())
                if d in _batch(z.meta["val"]) or not all(isinstance(i, Tensor) for i in chosen):
                    return False
        return True


def _replaced(args: Any, by: dict) -> Any:
    return map_arg(args, lambda n: by.get(n, n))


def _dims(node: Any, position: int) -> list[int]:
    """Returns along what dimensions something is done, none for a fold of all."""
    dims = None if node.target in FOLDS else 0
    dims = node.args[position] if len(node.args) > position else dims
    return [dims] if isinstance(dims, int) else list(dims or [])


def _known(op: Any, a: Any, b: Any = None, c: Any = None) -> Any:
    """Returns what an operation with 0, 1 or a known condition is, or None.

    So 0 times anything is 0, also what is not finite.
    """
    if op is aten.mul.Tensor and (_is(a, 0) or _is(b, 0)):
        return a if _is(a, 0) else b
    if op is aten.div.Tensor and _is(a, 0):
        return a
    if op is aten.mul.Tensor and _is(a, 1) or op is aten.add.Tensor and _is(a, 0):
        return b
    if op in (aten.mul.Tensor, aten.div.Tensor) and _is(b, 1):
        return a
    if op in (aten.add.Tensor, aten.sub.Tensor) and _is(b, 0):
        return a
    if op is aten.where.self and isinstance(a, Tensor):
        return b if a else c
    return None


def _is(entry: Any, value: int) -> bool:
    return isinstance(entry, Tensor) and bool(entry == value)


def _dtype(entry: Any) -> Any:
    return getattr(entry.meta["val"] if isinstance(entry, Node) else entry, "dtype", None)


def _tensors(node: Any) -> list[Tensor]:
    """Returns what a node gives that is a tensor."""
    val = node.meta.get("val") if node.op != "output" else None
    return [z for z in (val if isinstance(val, list | tuple) else [val]) if isinstance(z, Tensor)]


def _batch(val: Any) -> list[int]:
    """Returns which dimension, if any, is that of the batch: its size is a symbol."""
    return [d for d, s in enumerate(getattr(val, "shape", ())) if not isinstance(s, int)]


def _are_small(vals: list[Any]) -> bool:
    """Returns whether tensors have few entries, and no more than one batch, all the same."""
    sizes = [[s.node.expr for s in z.shape if not isinstance(s, int)] for z in vals]
    one = len({s for symbols in sizes for s in symbols}) <= 1
    alone = all(len(symbols) <= 1 and all(s.is_Symbol for s in symbols) for symbols in sizes)
    return one and alone and all(0 < _one(z.shape).numel() <= LARGEST for z in vals)


def _one(shape: Any) -> torch.Size:
    """Returns a shape as if the batch had one member."""
    return torch.Size([s if isinstance(s, int) else 1 for s in shape])


def _before_batch(val: Any) -> int:
    """Returns how many rows lie before the dimension of the batch."""
    return math.prod(_one(val.shape[: (_batch(val) or [0])[0]]))
