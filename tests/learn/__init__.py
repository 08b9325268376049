"""These tests run where the `learn` extra is installed; the `test` extra does not bring PyTorch."""

import pytest

pytest.importorskip("torch", reason="the learn extra is not installed")
pytest.importorskip("stable_baselines3", reason="the learn extra is not installed")

import torch

torch.set_num_threads(1)  # as jobs do; on a busy machine more threads only wait for each other
