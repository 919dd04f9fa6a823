"""Whatever a system may depend on is watched, and what it does not depend on is not."""

import functools
import math
import types
from dataclasses import dataclass

import numpy as np
import pytest
import torch

import pypose_lite as pp
from pypose_lite.compiled.watch import changed, watch

FACTOR, TABLE, OTHER = 2.0, [1.0, 2.0], 5.0


@dataclass
class Wheel:
    radius: float = 0.3
    spokes: tuple = (1, 2)

    def turn(self, x):
        return x / self.radius


class Slotted:
    __slots__ = ("mass",)

    def __init__(self):
        self.mass = 1.0


def helper(x, scale=1.5):
    return FACTOR * x * scale + inner(x)


def inner(x):
    return [TABLE[0] * y for y in (x,)][0]


def closure(gain):
    return lambda x: gain * x


class Base(pp.NLS):
    friction = 0.1

    @property
    def slip(self):
        return self.friction * 2


class Cart(Base):
    def __init__(self):
        super().__init__()
        self.mass, self.wheel, self.slotted = 1.0, Wheel(), Slotted()
        self.numbers = {"a": [1.0, {"b": 2.0}]}
        self.array = np.zeros(2)
        self.push = closure(3.0)
        self.half = functools.partial(helper, scale=0.5)
        self.tensor = torch.zeros(2)
        self.net = torch.nn.Linear(2, 2)

    def state_transition(self, state, input):
        return helper(self.wheel.turn(state)) + self.static(state) + math.pi

    def observation(self, state, input):
        return state

    @staticmethod
    def static(x):
        return x

    @classmethod
    def of_class(cls, x):
        return x


def of_module(name, value):
    return lambda patch, cart: patch.setitem(globals(), name, value)


def of(get, name, value):
    return lambda patch, cart: patch.setattr(get(cart), name, value)


SEEN = {
    "number": of(lambda c: c, "mass", 2.0),
    "new number": lambda patch, cart: vars(cart).update(extra=1),
    "number gone": lambda patch, cart: vars(cart).pop("mass"),
    "tensor": of(lambda c: c, "tensor", torch.zeros(2)),
    "parameter": lambda patch, cart: setattr(cart.net, "bias", torch.nn.Parameter(torch.ones(2))),
    "object's number": of(lambda c: c.wheel, "radius", 0.4),
    "object's tuple": of(lambda c: c.wheel, "spokes", (1, 3)),
    "object's slot": of(lambda c: c.slotted, "mass", 2.0),
    "object's method": of(lambda c: Wheel, "turn", lambda self, x: x),
    "object": of(lambda c: c, "wheel", Wheel()),
    "class number": of(lambda c: Base, "friction", 0.2),
    "property": of(lambda c: Base, "slip", property(lambda self: 1)),
    "method": of(lambda c: Cart, "static", staticmethod(lambda x: 2 * x)),
    "class method": of(lambda c: Cart, "of_class", classmethod(lambda cls, x: 2 * x)),
    "class": lambda patch, cart: setattr(cart, "__class__", type("Other", (Cart,), {})),
    "own function": of(lambda c: c, "state_transition", lambda state, input: state),
    "list": lambda patch, cart: cart.numbers["a"].append(1),
    "dictionary": lambda patch, cart: cart.numbers["a"][1].update(b=3.0),
    "array": lambda patch, cart: cart.array.fill(1),
    "closure": lambda patch, cart: setattr(cart.push.__closure__[0], "cell_contents", 4.0),
    "partial": of(lambda c: c, "half", functools.partial(helper, scale=0.6)),
    "global": of_module("FACTOR", 3.0),
    "global function": of_module("helper", lambda x: x),
    "global of a helper": of_module("inner", lambda x: x),
    "global list": lambda patch, cart: TABLE.append(7.0),
    "code": of(lambda c: inner, "__code__", (lambda x: x).__code__),
    "default": of(lambda c: helper, "__defaults__", (1.6,)),
}


@pytest.mark.parametrize("what", SEEN)
def test_a_change_is_seen(monkeypatch, what):
    cart = Cart()
    noted = watch(cart)
    assert not changed(noted)
    SEEN[what](monkeypatch, cart)
    assert changed(noted)


UNSEEN = {
    "nothing": lambda patch, cart: None,
    "clock": lambda patch, cart: cart.reset(3),
    "a step": lambda patch, cart: cart(torch.zeros(2), torch.zeros(1)),
    "reference point": lambda patch, cart: cart.set_refpoint(torch.zeros(2), torch.zeros(1)),
    "tensor's numbers": lambda patch, cart: cart.tensor.add_(1),
    "training": lambda patch, cart: cart.eval(),
    "global that it does not name": of_module("OTHER", 6.0),
    "a module's content": lambda patch, cart: patch.setattr(math, "tau", 3.0),
}


@pytest.mark.parametrize("what", UNSEEN)
def test_what_a_step_does_not_depend_on_is_not_watched(monkeypatch, what):
    cart = Cart()
    noted = watch(cart)
    UNSEEN[what](monkeypatch, cart)
    assert not changed(noted)


def test_looking_is_quick_and_goes_in_circles_once():
    cart = Cart()
    cart.myself = [cart]
    noted = watch(cart)
    assert len(noted) < 400 and not changed(noted)
    assert not any(isinstance(thing, types.ModuleType) for thing, _, _ in noted)
