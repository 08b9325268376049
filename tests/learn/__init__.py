"""These tests run where the `learn` extra is installed; the `test` extra does not bring PyTorch."""

from tests.machine import need_module

need_module("learn")

import torch  # noqa: E402

torch.set_num_threads(1)  # as jobs do; on a busy machine more threads only wait for each other
