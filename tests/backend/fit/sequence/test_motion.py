"""What is known of motion: which frames, which groups, which differences."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.fit.sequence.course import Course
from facestage.fit.sequence.motion import GAZE, LIDS, MOUTH, REST, Triples, groups_of
from facestage.fit.sequence.pose_noise import with_honest_poses
from facestage.fit.sequence.smoother import Evidence


def test_expressions_of_one_kind_share_a_group():
    names = ("jawOpen", "mouthSmile_L", "eyeBlink_R", "eyeLookUp_L", "browDown_L")
    assert groups_of(names)[6:].tolist() == [MOUTH, MOUTH, LIDS, GAZE, REST]


def test_even_motion_has_no_second_difference_whatever_the_times():
    times = np.array([0.0, 0.04, 0.08, 0.16, 0.2, 0.28])
    course = Course(
        Rotation.from_rotvec(times[:, None] * [0.5, 0.2, -0.1]).as_matrix(),
        times[:, None] * [0.1, 0.0, 0.3],
        times[:, None] * [1.0, 2.0],
    )
    triples = Triples.of(times, np.zeros(6, int))
    assert len(triples.frames) == 4
    np.testing.assert_allclose(triples.differences(course), 0, atol=1e-12)
    assert np.abs(triples.applied(times[:, None] ** 2)).min() > 1e-4


def test_no_triple_lies_across_a_cut():
    triples = Triples.of(np.arange(8.0), np.array([1, 1, 1, 1, 2, 2, 2, 2]))
    assert triples.frames.tolist() == [[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7]]
    assert Triples.of(np.arange(2.0), np.ones(2, int)).differences(
        Course(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.zeros((2, 1)))
    ).shape == (0, 7)


def test_poses_are_as_uncertain_as_they_scatter():
    frames, size = 400, 8
    scatter = np.array([0, 0, 0, 0, 0, 0.004])
    own = np.zeros((frames, size))
    own[:, :6] = np.random.default_rng(0).normal(size=(frames, 6)) * scatter
    hessian = np.tile(np.diag(np.full(size, 1e6)), (frames, 1, 1))
    evidence = Evidence(hessian, -np.einsum("tij,tj->ti", hessian, own))
    course = Course(
        np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3)), np.zeros((frames, size - 6))
    )
    honest = with_honest_poses(course, evidence, np.zeros(frames, int))
    deviation = 1 / np.sqrt(np.einsum("tii->ti", honest.hessian)[0])
    np.testing.assert_allclose(deviation[[0, 4, 7]], 1e-3)
    assert 0.8 < deviation[5] / 0.004 < 1.25
    found = np.linalg.solve(honest.hessian, -honest.gradient[..., None])[..., 0]
    np.testing.assert_allclose(found, own, atol=1e-12)
