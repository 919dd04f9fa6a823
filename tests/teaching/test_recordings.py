"""The recording of the mower is what its source says."""

import torch

from pypose_lite.teaching import recordings


def test_odometry_starts_at_the_true_pose_and_follows_the_truth_for_a_while():
    mower = recordings.mower()
    heading = mower.start[2] + mower.u[:, 1].cumsum(0)
    steps = mower.u[:, :1] * torch.stack([heading.cos(), heading.sin()], -1)
    places = mower.start[:2] + torch.cat([torch.zeros(1, 2, dtype=torch.float64), steps.cumsum(0)])
    off = (places[:-1] - mower.truth).norm(dim=-1)
    assert off[0] == 0
    assert off[:150].max() < 3 < 10 < off[-1]  # m


def test_distances_are_those_to_the_posts_but_for_seven_percent():
    mower = recordings.mower()
    heard = mower.post >= 0
    assert heard.equal(~mower.distance.isnan()) and 600 < heard.sum() < 800
    true = (mower.posts[mower.post[heard]] - mower.truth[heard]).norm(dim=-1)
    scale = (true * mower.distance[heard]).sum() / true.square().sum()
    assert 1.06 < scale < 1.08
    assert (mower.distance[heard] - scale * true).std() < 0.7  # m


def test_the_source_is_named_beside_the_data():
    folder = recordings.Path(recordings.__file__).parent
    text = (folder / "SOURCE.md").read_text(encoding="utf-8")
    assert "Djugash" in text and "BSD" in text
