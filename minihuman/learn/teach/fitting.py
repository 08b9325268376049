"""Fitting: gradient steps that are seeded, stop at a time limit, and go on from a file as if nothing had been."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch
from torch import nn

from minihuman.learn.agent.training import read_checkpoint, save_atomically

SAVE_EVERY = 200  # updates

Loss = Callable[[torch.Generator], torch.Tensor]  # of one minibatch, which it draws


@contextlib.contextmanager
def seeded(rng: np.random.Generator) -> Iterator[None]:
    """Torch's own chance comes from ``rng`` in here, and is as before afterwards."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**63)))
        yield


def fit(
    parameters: nn.Module,
    loss_of: Loss,
    rng: np.random.Generator,
    *,
    updates: int,
    learning_rate: float,
    weight_decay: float = 0.0,
    most_norm: float = 0.0,
    warm_up: int = 0,
    averaged: float = 0.0,
    budget_s: float = float("inf"),
    checkpoint: Path | None = None,
) -> tuple[int, float]:
    """Make so many updates with Adam, or as many as there is time for; one at least.

    Args:
        parameters: What is fitted, in place.
        loss_of: The loss of a minibatch, drawn with the generator that it is given.
        rng: Seeds that generator.
        updates: How many updates are wanted.
        learning_rate: Adam's.
        weight_decay: Adam's.
        most_norm: Gradients longer than this are cut to it; 0 leaves them.
        warm_up: The learning rate grows to its full height over so many updates: Adam's first steps are as long as any,
            and can push the units of a network of convolutions so far that most of them never answer again.
        averaged: What is left in the end is a running average of the weights, in which those of an update before count
            so much less; 0 leaves the last ones. It may not depend on how many updates there are to be.
        budget_s: Seconds.
        checkpoint: A file to go on from; written every so often, and gone at the end.

    Returns:
        The updates that were made, those before the checkpoint included, and the mean loss of the last fifty.
    """
    optimiser = torch.optim.Adam(parameters.parameters(), lr=learning_rate, weight_decay=weight_decay, fused=True)
    generator = torch.Generator().manual_seed(int(rng.integers(2**63)))
    done, losses = 0, list[float]()
    average = {name: torch.zeros_like(values) for name, values in parameters.named_parameters()} if averaged else {}
    if checkpoint is not None and checkpoint.exists():
        saved = read_checkpoint(checkpoint)
        parameters.load_state_dict(saved["weights"])
        optimiser.load_state_dict(saved["optimiser"])
        generator.set_state(saved["generator"])
        done, losses, average = saved["updates"], saved["losses"], saved["average"]
    ends = time.monotonic() + budget_s
    while done < updates and (done == 0 or time.monotonic() < ends):
        loss = loss_of(generator)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        if most_norm:
            nn.utils.clip_grad_norm_(parameters.parameters(), most_norm)
        for group in optimiser.param_groups if done < warm_up else ():
            group["lr"] = learning_rate * (done + 1) / warm_up
        optimiser.step()
        done += 1
        with torch.no_grad():
            for name, values in parameters.named_parameters() if averaged else ():
                average[name].lerp_(values, 1 - averaged)
        losses = [*losses[-49:], loss.item()]
        if checkpoint is not None and done % SAVE_EVERY == 0:
            save_atomically(
                {
                    "weights": parameters.state_dict(),
                    "optimiser": optimiser.state_dict(),
                    "generator": generator.get_state(),
                    "updates": done,
                    "losses": losses,
                    "average": average,
                },
                checkpoint,
            )
    with torch.no_grad():
        for name, values in parameters.named_parameters() if averaged else ():
            values.copy_(average[name] / (1 - averaged**done))
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return done, float(np.mean(losses)) if losses else float("nan")
