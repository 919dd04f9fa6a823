"""A real recording: a robot lawn mower that measures its distance to four radios.

``SOURCE.md`` says where it comes from.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy
import torch
from torch import Tensor

POSTS = [[-68.927, 18.378], [-37.581, 69.228], [-33.621, 26.968], [1.709, -5.812]]  # m
HEADING = math.pi - 2.021089  # rad, at the start


class Mower(NamedTuple):
    """The recording, in steps of 0.2 s."""

    u: Tensor  # how far it rolled (m) and turned (rad), by its wheels and its gyroscope, (800, 2)
    post: Tensor  # which radio answered, 0 to 3; -1 where none did, (800,)
    distance: Tensor  # what it said, m; nan where none did, (800,)
    posts: Tensor  # where the radios are, m, (4, 2)
    start: Tensor  # the pose at the start [i (m), j (m), heading (rad)], (3,)
    truth: Tensor  # the position by a precise satellite receiver, m, (800, 2)


def mower() -> Mower:
    """Returns the recording of the mower, in float64.

    Source: J. Djugash, B. Hamner, S. Roth, "Navigating with ranging radios: Five data sets with
    ground truth", Journal of Field Robotics 26(9), 2009; the first 160 s of "Plaza 2".
    """
    path = Path(__file__).with_name("mower.csv")
    table = torch.from_numpy(numpy.loadtxt(path, delimiter=",", skiprows=1, encoding="utf-8"))
    posts = torch.tensor(POSTS, dtype=torch.float64)
    start = torch.tensor([*table[0, 4:].tolist(), HEADING], dtype=torch.float64)
    return Mower(table[:, :2], table[:, 2].long(), table[:, 3], posts, start, table[:, 4:])
