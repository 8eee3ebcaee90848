"""Pigment and height over a plain square: known fields, known lights."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.textures.relief_maps.height_field import Spread, _Fields, solved
from facestage.fit.textures.relief_maps.relief_evidence import Evidence, difference
from facestage.fit.textures.relief_maps.relief_share import Found, share_of, spread_of

SIZE, TEXEL = 128, 0.5  # mm
SPACING = np.full((SIZE, SIZE), TEXEL)
WEIGHT = 1.0 / 0.03**2


def waves(length: float, seed: int, angle: float | None = None) -> np.ndarray:
    """(SIZE, SIZE) of unit variance, of waves of about ``length`` mm; all in one direction where
    there is an ``angle``.
    """
    rng = np.random.default_rng(seed)
    y, x = TEXEL * np.mgrid[:SIZE, :SIZE]
    total = np.zeros((SIZE, SIZE))
    for _ in range(60):
        turn = rng.uniform(0, 2 * np.pi) if angle is None else angle
        k = 2 * np.pi / (length * rng.uniform(0.8, 1.25))
        total += np.sin(k * (np.cos(turn) * x + np.sin(turn) * y) + rng.uniform(0, 2 * np.pi))
    return total / total.std()


def seen(height: np.ndarray, pigment: np.ndarray, *lights: tuple[float, float]) -> Evidence:
    """What photos under lights of these derivatives by the slope show; a border is not seen."""
    right, below = difference(height, 1), difference(height, 0)
    weight = np.zeros((SIZE, SIZE))
    weight[8:-8, 8:-8] = WEIGHT
    total = None
    for g in lights:
        a, b = np.array(g) / TEXEL
        value = pigment + a * right + b * below
        one = Evidence(
            weight,
            weight * value,
            np.stack([weight * a, weight * b]),
            np.stack([weight * a * value, weight * b * value]),
            np.stack([weight * a * a, weight * a * b, weight * b * b]),
            np.zeros_like(weight),
        )
        total = one if total is None else total + one
    assert total is not None
    return total


def similar(found: np.ndarray, true: np.ndarray) -> float:
    """Correlation of the slopes within the part that is seen."""
    inner = np.s_[16:-16, 16:-16]
    a, b = (
        np.concatenate([difference(each, k)[inner].ravel() for k in (0, 1)])
        for each in (found, true)
    )
    return float(a @ b / np.sqrt((a @ a) * (b @ b) + 1e-30))


def test_three_lights_tell_height_from_pigment():
    height, pigment = 0.05 * waves(4.0, 1), 0.05 * waves(4.0, 2)
    found, painted = solved(
        seen(height, pigment, (1.0, 0.0), (-0.6, 0.8), (-0.4, -0.9)), SPACING, Spread(0.04, 0.05)
    )
    inner = np.s_[16:-16, 16:-16]
    error = (painted - pigment)[inner].std() / pigment[inner].std()
    print(f"slopes {similar(found, height):.3f} alike; pigment off by {error:.2f} of itself")
    assert similar(found, height) > 0.95 and error < 0.3


def test_one_light_shows_what_runs_along_it_and_nothing_else():
    spread = Spread(0.01, 0.05)
    along, across = 0.05 * waves(4.0, 1, angle=0.0), 0.05 * waves(4.0, 1, angle=np.pi / 2)
    nothing = np.zeros((SIZE, SIZE))
    found, _ = solved(seen(along, nothing, (1.0, 0.0)), SPACING, spread)
    hidden, _ = solved(seen(across, nothing, (1.0, 0.0)), SPACING, spread)
    print(f"along {similar(found, along):.3f} alike; across {hidden.std() / across.std():.1e}")
    assert similar(found, along) > 0.9 and hidden.std() < 0.05 * across.std()


def test_paint_leaves_no_relief():
    """Where brows or lips may be, a dark line is that, whatever way it runs."""
    line = np.zeros((SIZE, SIZE))
    line[:, 60:66] = -1.0
    evidence = seen(np.zeros((SIZE, SIZE)), line, (1.0, 0.0))
    plain, _ = solved(evidence, SPACING, Spread(0.03, 0.03))
    evidence.paint[:, 50:76] = 2.0
    painted, _ = solved(evidence, SPACING, Spread(0.03, 0.03))
    print(f"{np.abs(plain).max():.3f} mm engraved as skin, {np.abs(painted).max():.3f} as paint")
    assert np.abs(painted).max() < 0.1 * np.abs(plain).max()


def test_freckles_leave_less_relief_where_pigment_is_known_roughly():
    """They are sparse, and no Gaussian field: the first time a height takes its share of them."""
    rng = np.random.default_rng(6)
    y, x = TEXEL * np.mgrid[:SIZE, :SIZE]
    freckles = np.zeros((SIZE, SIZE))
    for place in rng.uniform(0, TEXEL * SIZE, (40, 2)):
        freckles -= 0.3 * np.exp(-0.5 * ((x - place[0]) ** 2 + (y - place[1]) ** 2) / 0.8**2)
    height = 0.04 * waves(4.0, 1)
    evidence, spread = seen(height, freckles, (1.0, 0.0)), Spread(0.04, 0.08)
    first, pigment = solved(evidence, SPACING, spread)
    second, _ = solved(evidence, SPACING, spread, pigment)
    before, after = similar(first, height), similar(second, height)
    print(f"slopes {before:.3f} alike at first, {after:.3f} then")
    assert 1 - after**2 < 0.85 * (1 - before**2)


def test_darkness_has_no_relief():
    none, two, three = (np.zeros((*count, SIZE, SIZE)) for count in ((), (2,), (3,)))
    dark = Evidence(none, none, two, two, three, none)
    height, pigment = solved(dark, SPACING, Spread(0.03, 0.03))
    assert not height.any() and not pigment.any()
    assert spread_of([share_of(dark, SPACING)]) is None


def test_the_system_is_the_energy_s_slope_and_curvature():
    """Against finite differences of |white|^2 / 2 + sum w (a + g . grad h - y)^2 / 2."""
    rng = np.random.default_rng(3)
    evidence = seen(0.05 * waves(4, 1), 0.05 * waves(4, 2), (1.0, 0.2), (-0.5, 0.9))
    fields = _Fields(evidence, SPACING, Spread(0.04, 0.05))

    def energy(white: np.ndarray) -> float:
        pigment, height = fields.colored(white).astype(np.float64)
        right, below = difference(height, 1), difference(height, 0)
        total = 0.5 * float((white.astype(np.float64) ** 2).sum())
        s, q = evidence.slope, evidence.slopes
        total += float((0.5 * evidence.weight * pigment**2 - evidence.value * pigment).sum())
        total += float((pigment * (s[0] * right + s[1] * below)).sum())
        total += float((0.5 * q[0] * right**2 + q[1] * right * below + 0.5 * q[2] * below**2).sum())
        v = evidence.slope_value
        return total - float((v[0] * right + v[1] * below).sum())

    at = 0.5 * rng.normal(size=(2, *fields.shape)).astype(np.float32)
    step = rng.normal(size=at.shape).astype(np.float32)
    e = 0.05
    plus, minus, middle = (energy(at + k * e * step) for k in (1, -1, 0))
    right = fields.whitened(fields._by_fields(evidence.value, *evidence.slope_value))
    slope = float((step * (fields.curvature(at) - right)).sum())
    curved = float((step * fields.curvature(step)).sum())
    differences = (plus - minus) / (2 * e), (plus + minus - 2 * middle) / e**2
    print(f"slope {slope:.6g}, by differences {differences[0]:.6g}")
    assert slope == pytest.approx(differences[0], rel=2e-3)
    assert curved == pytest.approx(differences[1], rel=2e-3)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_directions_say_how_much_is_relief(share: float):
    """Fields of the same variance in y; of a height, half of the slopes' lies along the light."""
    height, pigment = waves(5.0, 4), waves(5.0, 5)
    by_height = difference(height, 1) / TEXEL
    height = height * np.sqrt(share) * 0.05 / by_height.std()
    evidence = seen(height, np.sqrt(1 - share) * 0.05 * pigment, (1.0, 0.0))
    found = share_of(evidence, SPACING)
    print(f"{found.share:.2f} is relief, true {share}, by {found.texels} texels")
    assert found.share == pytest.approx(share, abs=0.25)
    if share == 0:
        assert spread_of([found]) is None or found.share > 0.1


def test_pigment_is_no_change_between_two_lights():
    """What runs along both lights and stays is pigment; what changes with them is height."""
    nothing = np.zeros((SIZE, SIZE))
    one, other = (1.5, 0.0), (-1.5, 0.0)
    lines = 0.05 * waves(5.0, 4, angle=0.0)
    lines += 0.02 * waves(5.0, 7)
    bumps = 0.02 * waves(5.0, 5)

    def told(height: np.ndarray, pigment: np.ndarray) -> tuple[Spread | None, Spread | None]:
        """By one photo alone, and by two."""
        first, second = (seen(height, pigment, light) for light in (one, other))
        change = share_of(second.smoothed().without(first.smoothed()), SPACING)
        found = [share_of(each, SPACING) for each in (first, second)]
        return spread_of(found[:1]), spread_of(found, [change])

    alone, both = told(nothing, lines)
    assert alone is not None and both is None
    alone, both = told(bumps, 0.02 * waves(5.0, 6))
    assert alone is not None and both is not None


def test_soft_light_tells_of_relief_only_where_it_changes():
    """A single photo has to be lit so that slopes show, and so have several in the same light."""
    soft, hard = (Found(0.001, 0.001, sensitivity, 10_000) for sensitivity in (0.8, 2.0))
    changed, same = Found(0.001, 0.001, 0.5, 10_000), Found(0.0, 1.0, 0.01, 10_000)
    assert spread_of([soft]) is None and spread_of([soft, soft], [same]) is None
    assert spread_of([hard]) is not None and spread_of([hard, hard], [same]) is not None
    assert spread_of([soft, soft], [changed]) is not None
