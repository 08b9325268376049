import numpy as np
import pytest

from minihuman.exporters.lerobot import QUANTILES, FeatureStatistics


def test_a_pictures_statistics_are_those_of_its_values_from_0_to_1():
    pictures = np.random.default_rng(3).integers(0, 256, (4, 30, 20, 3), dtype=np.uint8)
    found = FeatureStatistics(pictures).statistics()
    values = pictures.reshape(-1, 3) / 255
    assert np.ravel(found["mean"]) == pytest.approx(values.mean(axis=0))
    assert np.ravel(found["std"]) == pytest.approx(values.std(axis=0))
    for name, level in QUANTILES.items():
        assert np.ravel(found[name]) == pytest.approx(np.quantile(values, level, axis=0), abs=2 / 255), name


def test_two_episodes_count_by_their_frames():
    rng = np.random.default_rng(4)
    first, second = rng.normal(0, 1, (10, 2)), rng.normal(5, 1, (30, 2))
    both = FeatureStatistics(first)
    both.add(FeatureStatistics(second))
    found = both.statistics()
    assert found["count"] == [40]
    assert found["mean"] == pytest.approx(np.concatenate([first, second]).mean(axis=0))
    expected = (10 * np.quantile(first, 0.5, axis=0) + 30 * np.quantile(second, 0.5, axis=0)) / 40
    assert found["q50"] == pytest.approx(expected)
