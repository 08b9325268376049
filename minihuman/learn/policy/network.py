"""The policy network, and a fast forward pass for one observation.

The network computes 32 features of the mission and 64 of the image. The forward pass takes half the time of calling the
layers one after another, since an image of one row gains nothing from what layers prepare for batches. It computes the
same sums in another order, with differences of at most 1e-6.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, Literal

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, NatureCNN
from torch import nn

from minihuman.learn.policy.action_distributions import ActionDistribution, CategoricalActions, GaussianActions
from minihuman.learn.policy.observation import SPREAD, Observation

EncoderName = Literal["grid", "atari", "map", "codes", "near", "planes", "cells", "near cells", "flat"]

MISSION_FEATURES = 32
IMAGE_FEATURES = 64
CODES = (11, 6, 3)  # the numbers of kinds, colours and states that a grid's cell can have
ACTOR_HEAD = "action_net."


class GridEncoder(nn.Sequential):
    """An image encoder for views of a few cells: three 2x2 convolutions (16, 32, 64) and a linear layer."""

    def __init__(self, space: spaces.Box) -> None:
        channels, height, width = space.shape
        super().__init__(
            nn.Conv2d(channels, 16, 2),
            nn.ReLU(),
            nn.Conv2d(16, 32, 2),
            nn.ReLU(),
            nn.Conv2d(32, 64, 2),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(64 * (height - 3) * (width - 3), IMAGE_FEATURES),
            nn.ReLU(),
        )


class MapEncoder(nn.Sequential):
    """An image encoder for a whole grid from above: three 3x3 convolutions (16, 32, 64) of stride 2, a linear layer."""

    def __init__(self, space: spaces.Box) -> None:
        channels, height, width = space.shape
        super().__init__(*_padded_convolutions(channels, 64 * -(-height // 8) * -(-width // 8), first_stride=2))


def _padded_convolutions(channels: int, n_flat: int, *, first_stride: int) -> list[nn.Module]:
    """Return three 3x3 convolutions (16, 32, 64; the last two of stride 2) and a linear layer of ``n_flat`` inputs."""
    return [
        nn.Conv2d(channels, 16, 3, stride=first_stride, padding=1),
        nn.ReLU(),
        nn.Conv2d(16, 32, 3, stride=2, padding=1),
        nn.ReLU(),
        nn.Conv2d(32, 64, 3, stride=2, padding=1),
        nn.ReLU(),
        nn.Flatten(),
        nn.Linear(n_flat, IMAGE_FEATURES),
        nn.ReLU(),
    ]


class PlaneEncoder(nn.Sequential):
    """An image encoder for a kitchen's unscaled planes: two 3x3 convolutions (32, 32) and a linear layer."""

    def __init__(self, space: spaces.Box) -> None:
        channels, height, width = space.shape
        super().__init__(
            nn.Conv2d(channels, 32, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(32, 32, 3, padding=1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(32 * height * width, IMAGE_FEATURES),
            nn.ReLU(),
        )

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Return features float32[batch, 64] of planes with values in 0 to 1."""
        features: torch.Tensor = super().forward(image * 255)  # type: ignore[no-untyped-call]
        return features


class CodeEncoder(nn.Module):
    """An image encoder for spread grid codes: the kind, colour and state of each cell, and two linear layers.

    The layers have 128 and 64 units; the first one is a linear layer of one-hot codes. For grids of about ten cells on
    a side, this encoder takes a tenth of the time of convolutions and learns more from few steps.
    """

    sizes: ClassVar[tuple[int, int, int]] = CODES  # the numbers of kinds, colours and states
    factors: ClassVar[tuple[int, int, int]] = SPREAD  # by which a channel's codes are multiplied
    spread: torch.Tensor
    offsets: torch.Tensor

    def __init__(self, space: spaces.Box) -> None:
        super().__init__()
        self.register_buffer("spread", torch.tensor(self.factors, dtype=torch.uint8).view(3, 1, 1), persistent=False)
        self.register_buffer("offsets", self._number_inputs(space), persistent=False)
        self.layers = self._layers(space)

    def _number_inputs(self, space: spaces.Box) -> torch.Tensor:
        """Return the number of the first layer's input for code 0 of each channel and cell, int64[3, rows, columns].

        The inputs for the kinds of all cells come first, then those for their colours, then those for their states.
        """
        _, height, width = space.shape
        cells = torch.arange(height * width).view(height, width)
        first = [height * width * sum(self.sizes[:channel]) for channel in range(len(self.sizes))]
        return torch.stack([cells * size + start for size, start in zip(self.sizes, first, strict=True)])

    def _layers(self, space: spaces.Box) -> nn.Sequential:
        _, height, width = space.shape
        inputs = height * width * sum(self.sizes)
        return nn.Sequential(nn.Linear(inputs, 128), nn.ReLU(), nn.Linear(128, IMAGE_FEATURES), nn.ReLU())

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Return features float32[batch, 64] of spread codes: uint8, or floats in 0 to 1."""
        first, *later_layers = self.layers
        assert isinstance(first, nn.Linear)
        inputs = (self._read_codes(image).long() + self.offsets).flatten(1)
        features: torch.Tensor = InputLookup.apply(inputs, first.weight, first.bias)  # type: ignore[no-untyped-call]
        for layer in later_layers:
            features = layer(features)
        return features

    def _read_codes(self, image: torch.Tensor) -> torch.Tensor:
        """Return the codes uint8[batch, 3, rows, columns] of an image of spread codes: uint8, or floats in 0 to 1."""
        if image.dtype != torch.uint8:
            image = (image * 255).round_().to(torch.uint8)
        return torch.div(image, self.spread, rounding_mode="floor")


class InputLookup(torch.autograd.Function):
    """A linear layer whose inputs are 0 or 1 and are given by the numbers of the inputs that are 1.

    Both passes skip the inputs that are 0 in the whole batch, which are three quarters of a grid view's.
    """

    @staticmethod
    def forward(ctx: Any, inputs: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
        """Return float32[batch, units]; ``inputs`` are the numbers int64[batch, ones] of inputs that are 1."""
        ones = torch.zeros(len(inputs), weight.shape[1], device=inputs.device).scatter_(1, inputs, 1.0)
        used = ones.sum(dim=0).nonzero().squeeze(1)
        ones = ones.index_select(1, used)
        ctx.save_for_backward(ones, used)
        ctx.weight_shape = weight.shape
        return torch.addmm(bias, ones, weight.index_select(1, used).t())

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[None, torch.Tensor, torch.Tensor]:
        """Return the gradients of the weight and the bias; inputs have none."""
        (gradient,) = gradients
        ones, used = ctx.saved_tensors
        weight_gradient = torch.zeros(ctx.weight_shape, device=gradient.device)
        weight_gradient.index_copy_(1, used, gradient.t() @ ones)
        return None, weight_gradient, gradient.sum(dim=0)


class CellEncoder(CodeEncoder):
    """`CodeEncoder` for codes that are not spread: all 16 kinds, 8 colours and 4 states that a cell can have.

    It serves worlds that define their own kinds, and team worlds, whose bodies have directions.
    """

    sizes = (16, 8, 4)
    factors = (1, 1, 1)


class LocalCodeEncoder(CodeEncoder):
    """An image encoder for remembered cells around the agent: one-hot cells, convolutions and a linear layer.

    Three 3x3 convolutions (16, 32, 64), the last two with stride 2, treat a gap in a wall alike wherever it lies.
    """

    def _layers(self, space: spaces.Box) -> nn.Sequential:
        _, height, width = space.shape
        n_flat = 64 * -(-height // 4) * -(-width // 4)
        return nn.Sequential(*_padded_convolutions(sum(self.sizes), n_flat, first_stride=1))

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Return features float32[batch, 64] of spread codes: uint8, or floats in 0 to 1."""
        codes = self._read_codes(image).long()
        hot = [nn.functional.one_hot(codes[:, channel], size) for channel, size in enumerate(self.sizes)]
        features: torch.Tensor = self.layers(torch.cat(hot, dim=3).float().permute(0, 3, 1, 2))
        return features


class LocalCellEncoder(LocalCodeEncoder):
    """`LocalCodeEncoder` for codes that are not spread, like `CellEncoder`."""

    sizes = (16, 8, 4)
    factors = (1, 1, 1)


class FlatEncoder(nn.Sequential):
    """An image encoder without convolutions: two linear layers of 128 and 64 units."""

    def __init__(self, space: spaces.Box) -> None:
        layers = nn.Linear(math.prod(space.shape), 128), nn.ReLU(), nn.Linear(128, IMAGE_FEATURES), nn.ReLU()
        super().__init__(nn.Flatten(), *layers)


_ENCODERS: dict[EncoderName, Callable[[spaces.Box], nn.Module]] = {
    "grid": GridEncoder,
    "codes": CodeEncoder,
    "near": LocalCodeEncoder,
    "map": MapEncoder,
    "cells": CellEncoder,
    "near cells": LocalCellEncoder,
    "planes": PlaneEncoder,
    "flat": FlatEncoder,
    "atari": partial(NatureCNN, features_dim=IMAGE_FEATURES),
}


class MissionImageExtractor(BaseFeaturesExtractor):
    """A feature extractor for observations {"image", "mission"}: 64 features of the image, then 32 of a mission."""

    def __init__(self, observation_space: spaces.Dict, eyes: EncoderName) -> None:
        image = observation_space["image"]
        assert isinstance(image, spaces.Box)
        mission = observation_space.spaces.get("mission")
        n_features = IMAGE_FEATURES
        if mission is not None:
            n_features += MISSION_FEATURES
        super().__init__(observation_space, n_features)
        self.image = _ENCODERS[eyes](image)
        for layer in self.image.modules():
            if isinstance(layer, nn.ReLU):
                layer.inplace = True
        self.mission: nn.Module | None = None
        if mission is not None:
            assert mission.shape is not None
            self.mission = nn.Linear(mission.shape[0], MISSION_FEATURES)

    def forward(self, observation: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return features float32[batch, 64 or 96]."""
        image = observation["image"]
        if not isinstance(self.image, CodeEncoder):
            # the same results, in a third less time on the CPU
            image = image.contiguous(memory_format=torch.channels_last)
        features: torch.Tensor = self.image(image)
        if self.mission is None:
            return features
        return torch.cat((features, self.mission(observation["mission"])), dim=1)


class Policy(MultiInputActorCriticPolicy):
    """Stable-Baselines3's actor-critic for observations {"image", "mission"}, without its distribution objects.

    It computes the same numbers, in half the time per action.
    """

    distribution: ActionDistribution = CategoricalActions()

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.memory: nn.GRUCell | None = None
        self._hidden = torch.zeros(1, self.features_dim)  # the memory of the current episode

    def forward(
        self,
        obs: dict[str, torch.Tensor],  # type: ignore[override]
        deterministic: bool = False,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Draw actions; return actions int64[batch], values float32[batch, 1] and log-probabilities float32[batch]."""
        log_probs, values = self.compute_outputs(obs)
        if deterministic:
            actions = log_probs.argmax(dim=1, keepdim=True)
        else:
            actions = torch.multinomial(log_probs.exp(), 1, replacement=True)
        return actions.squeeze(1), values, log_probs.gather(1, actions).squeeze(1)

    def evaluate_actions(
        self,
        obs: dict[str, torch.Tensor],  # type: ignore[override]
        actions: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the values of states, the log-probabilities of actions, and each distribution's entropy in nats."""
        log_probs, values = self.compute_outputs(obs)
        chosen = log_probs.gather(1, actions.long().unsqueeze(1)).squeeze(1)
        return values, chosen, -(log_probs.exp() * log_probs).sum(dim=1)

    def probabilities(self, observation: Observation) -> torch.Tensor:
        """Return the probability float32[actions] of each action for one observation."""
        return self.compute_single_outputs(observation)[0].exp()

    def log_probabilities(self, obs: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return the log-probability float32[batch, actions] of each action, with gradients."""
        return self.compute_outputs(obs)[0]

    def compute_outputs(self, obs: dict[str, torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        """Return log-probabilities float32[batch, actions] and values float32[batch, 1] of states, with gradients."""
        return self._compute_heads(self._extract_features(obs))

    def compute_single_outputs(self, observation: Observation) -> tuple[torch.Tensor, torch.Tensor]:
        """Return log-probabilities float32[actions] and the value float32[1] for one observation, without gradients.

        A policy with a memory remembers the observation: call this method once per step, and call `forget` when an
        episode begins.
        """
        with torch.no_grad():
            obs = {name: torch.as_tensor(part)[None] for name, part in observation.items()}
            log_probs, values, self._hidden = self.compute_step_outputs(obs, self._hidden, torch.zeros(1))
        return log_probs[0], values[0]

    def forget(self) -> None:
        """Clear the memory at the beginning of an episode."""
        self._hidden = torch.zeros(1, self.features_dim)

    def compute_step_outputs(
        self, obs: dict[str, torch.Tensor], hidden: torch.Tensor, starts: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the distribution's outputs, the values and the new memory for one step of several episodes.

        Args:
            obs: the observations of the step, one row per episode
            hidden: the memory float32[batch, features]; returned unchanged by a policy without a memory
            starts: float32[batch], 1.0 where an episode begins, so that its memory is cleared
        """
        features = self._extract_features(obs)
        if self.memory is not None:
            features = hidden = self.memory(features, hidden * (1 - starts)[:, None])
        return *self._compute_heads(features), hidden

    def compute_sequence_outputs(
        self, obs: dict[str, torch.Tensor], hidden: torch.Tensor, starts: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the distribution's outputs and the values for consecutive steps of several episodes.

        Observations are [steps, batch, ...]; ``starts`` is [steps, batch], 1.0 where an episode begins. Results have
        steps * batch rows. Gradients flow through the memory, which is ``hidden`` at first.
        """
        features = self._extract_features({name: part.flatten(0, 1) for name, part in obs.items()})
        if self.memory is not None:
            hidden_states = []
            for step_features, step_starts in zip(features.view(*starts.shape, -1), starts, strict=True):
                hidden = self.memory(step_features, hidden * (1 - step_starts)[:, None])
                hidden_states.append(hidden)
            features = torch.cat(hidden_states)
        return self._compute_heads(features)

    def _extract_features(self, obs: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return the features float32[batch, features] of observations, after scaling pictures in uint8 to 0 to 1."""
        image = obs["image"]
        if image.dtype == torch.uint8 and not isinstance(self.features_extractor.image, CodeEncoder):
            image = image.float().div_(255)
        features: torch.Tensor = self.features_extractor({**obs, "image": image})
        return features

    def _compute_heads(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the distribution's outputs float32[batch, outputs] and the values float32[batch, 1] for features."""
        logits = self.action_net(self.mlp_extractor.policy_net(features))
        return torch.log_softmax(logits, dim=1), self.value_net(self.mlp_extractor.value_net(features))


class GaussianPolicy(Policy):
    """A policy whose actions are vectors: its outputs are means and logarithms of standard deviations."""

    distribution = GaussianActions()

    def _compute_heads(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        means = self.action_net(self.mlp_extractor.policy_net(features))
        outputs = torch.cat((means, self.log_std.expand_as(means)), dim=1)
        return outputs, self.value_net(self.mlp_extractor.value_net(features))


def get_policy_settings(eyes: EncoderName, hidden: tuple[int, ...] = (64, 64)) -> dict[str, object]:
    """Return Stable-Baselines3's keyword arguments for a `Policy`; ``hidden`` are the sizes of its tanh layers."""
    return {
        "features_extractor_class": MissionImageExtractor,
        "features_extractor_kwargs": {"eyes": eyes},
        "net_arch": {"pi": list(hidden), "vf": list(hidden)},
        "activation_fn": nn.Tanh,
        # Stable-Baselines3's own optimiser and epsilon, each step in one call
        "optimizer_kwargs": {"eps": 1e-5, "fused": True},
    }


def build_policy(
    observation_space: spaces.Dict,
    actions: int,
    eyes: EncoderName,
    *,
    memory: bool = False,
    hidden: tuple[int, ...] = (64, 64),
    initial_std: float | None = None,
) -> Policy:
    """Build a policy with fresh weights on the CPU, for discrete actions or for vectors.

    Args:
        observation_space: the space of observations.
        actions: the number of discrete actions, or the size of the vectors.
        eyes: the encoder of observations.
        memory: whether the policy has a recurrent layer.
        hidden: the sizes of the actor's and of the critic's layers.
        initial_std: the standard deviation with which vectors are drawn at first; None for discrete actions.
    """
    settings: dict[str, Any] = get_policy_settings(eyes, hidden)
    if initial_std is None:
        policy = Policy(observation_space, spaces.Discrete(actions), lambda _: 3e-4, **settings)
    else:
        settings["log_std_init"] = math.log(initial_std)
        policy = GaussianPolicy(observation_space, spaces.Box(-1.0, 1.0, (actions,)), lambda _: 3e-4, **settings)
    if memory:
        policy.memory = nn.GRUCell(policy.features_dim, policy.features_dim)
    return policy


ForwardPass = tuple[torch.Tensor, torch.Tensor]  # logits float32[actions], value float32[1]


def make_forward(policy: Policy) -> Callable[[Observation], ForwardPass]:
    """Return a function that computes the logits and the value for one observation, fast and on the CPU.

    The function uses the policy's present weights, so make it again after an update. Encoders with padded convolutions,
    or without convolutions, are computed layer by layer.
    """
    features = policy.features_extractor
    assert isinstance(features, MissionImageExtractor)
    compute_image_features = _make_image_encoder(features.image)
    mission = features.mission
    assert mission is None or isinstance(mission, nn.Linear)
    actor = policy.mlp_extractor.policy_net
    critic = policy.mlp_extractor.value_net
    action_net = policy.action_net
    value_net = policy.value_net
    assert isinstance(action_net, nn.Linear)
    assert isinstance(value_net, nn.Linear)

    def compute_forward_pass(observation: Observation) -> ForwardPass:
        with torch.no_grad():
            inputs = compute_image_features(torch.as_tensor(observation["image"]))
            if mission is not None:
                inputs = torch.cat((inputs, _apply_linear(mission, torch.as_tensor(observation["mission"]))))
            logits = _apply_linear(action_net, _apply_tanh_layers(actor, inputs))
            return logits, _apply_linear(value_net, _apply_tanh_layers(critic, inputs))

    return compute_forward_pass


def _make_image_encoder(eyes: nn.Module) -> Callable[[torch.Tensor], torch.Tensor]:
    """Return a function that encodes an image uint8[channels, height, width]; a convolution is one matrix product."""
    convolutions = [layer for layer in eyes.modules() if isinstance(layer, nn.Conv2d)]
    if not convolutions or any(layer.padding != (0, 0) for layer in convolutions):
        return lambda image: eyes(image[None].float() / 255)[0]
    (last,) = (layer for layer in eyes.modules() if isinstance(layer, nn.Linear))
    # kernel [rows * columns * channels, outputs] in the order of a patch with channels last, side, stride and bias
    kernels = [
        (
            layer.weight.detach().permute(0, 2, 3, 1).reshape(layer.out_channels, -1).t(),
            int(layer.kernel_size[0]),
            int(layer.stride[0]),
            _get_bias(layer),
        )
        for layer in convolutions
    ]

    def encode(image: torch.Tensor) -> torch.Tensor:
        x = image.permute(1, 2, 0).to(torch.float32, memory_format=torch.contiguous_format).div_(255)
        height, width, channels = x.shape
        for kernel, side, stride, bias in kernels:
            rows = (height - side) // stride + 1
            columns = (width - side) // stride + 1
            row = width * channels
            patches = x.as_strided((rows, columns, side, side * channels), (row * stride, channels * stride, row, 1))
            x = torch.addmm(bias, patches.reshape(rows * columns, -1), kernel).relu_()
            height = rows
            width = columns
            channels = len(bias)
        return _apply_linear(last, x.t().reshape(-1)).relu_()

    return encode


def _apply_tanh_layers(layers: nn.Module, x: torch.Tensor) -> torch.Tensor:
    for layer in layers.children():
        if isinstance(layer, nn.Linear):
            x = _apply_linear(layer, x)
        else:
            x = x.tanh_()
    return x


def _apply_linear(layer: nn.Linear, x: torch.Tensor) -> torch.Tensor:
    return torch.addmv(layer.bias, layer.weight, x)


def _get_bias(layer: nn.Conv2d) -> torch.Tensor:
    assert layer.bias is not None
    return layer.bias.detach()
