import math
import random
from fractions import Fraction

import gymnasium
import pytest

from minihuman.worlds.trigonometry import LARGEST_RAD, cosine, sine

BITS = 400


def _arctangent(inverse: int) -> int:
    """Of 1 / inverse, times 2**BITS."""
    total = term = (1 << BITS) // inverse
    nth = 1
    while term:
        term = -term // inverse**2
        nth += 2
        total += term // nth
    return total


PI = 4 * (4 * _arctangent(5) - _arctangent(239))  # Machin's formula


def _sine(angle: int) -> int:
    """Of an angle times 2**BITS, times 2**BITS: the series, in whole numbers."""
    angle %= 2 * PI
    total = term = angle
    nth = 1
    while term:
        term = -(term * angle >> BITS) * angle // ((nth + 1) * (nth + 2)) >> BITS
        nth += 2
        total += term
        if abs(term) <= 1:
            break
    return total


def _exactly(angle_rad: float, shift: int) -> float:
    numerator, denominator = angle_rad.as_integer_ratio()
    return float(Fraction(_sine((numerator << BITS) // denominator + shift), 1 << BITS))


def _angles(count: int) -> list[float]:
    rng = random.Random(27)
    near = [rng.randint(-2000, 2000) * math.pi / rng.choice((2, 4, 12, 24, 180)) for _ in range(count // 3)]
    turns = [rng.uniform(-math.pi, math.pi) for _ in range(count // 3)]
    return near + turns + [rng.uniform(-LARGEST_RAD, LARGEST_RAD) for _ in range(count // 3)]


def test_sine_and_cosine_are_the_doubles_nearest_to_the_true_value():
    angles = [angle for angle in _angles(3000) if angle]
    wrong = [angle for angle in angles if sine(angle) != _exactly(angle, 0)]
    wrong += [angle for angle in angles if cosine(angle) != _exactly(angle, PI // 2)]
    assert wrong == []


def test_the_reference_is_not_the_function_itself():
    assert [_exactly(angle, 0) for angle in (1.0, 2.0)] == pytest.approx([math.sin(1.0), math.sin(2.0)], abs=1e-15)


def test_angles_at_the_edges():
    assert math.copysign(1.0, sine(-0.0)) == -1.0
    assert (sine(0.0), cosine(0.0)) == (0.0, 1.0)
    for angle in (math.inf, -math.inf, math.nan, 2 * LARGEST_RAD):
        assert math.isnan(sine(angle))
        assert math.isnan(cosine(angle))


def test_a_first_person_world_steps_by_our_sine_where_it_is_told_to():
    host, ours = (gymnasium.make("minihuman/MiniWorld-FourRooms-v0").unwrapped for _ in range(2))
    ours.trig = 1
    for env in (host, ours):
        env.reset(seed=4)
    assert ours.state_hash() == host.state_hash()
    apart = 0
    for _ in range(3000):
        host.agent.dir = ours.agent.dir = ours.agent.dir + 0.1
        assert ours.agent.forward == (cosine(ours.agent.dir), -sine(ours.agent.dir))
        assert ours.agent.forward == pytest.approx(host.agent.forward, abs=1e-15)
        apart += ours.agent.forward != host.agent.forward
    assert apart <= 30
    saved = ours.save()
    ours.restore(saved)
    assert ours.agent.trig == 1
