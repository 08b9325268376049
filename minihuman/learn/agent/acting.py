"""Choosing one action: a policy's forward pass for one observation, written out.

Half the time of the layers one after another, since an image of one row gains nothing from what they prepare for
batches. The sums are the same ones in another order; a test holds them to 1e-6.
"""

from collections.abc import Callable

import torch
from torch import nn

from minihuman.learn.agent.network import MissionAndImage, Policy
from minihuman.learn.agent.observe import Observation

Thoughts = tuple[torch.Tensor, torch.Tensor]  # logits float32[actions], value float32[1]


def thinker(policy: Policy) -> Callable[[Observation], Thoughts]:
    """What the policy makes of one observation, on the CPU, by its weights at this moment: ask again after an update.

    Eyes with padded convolutions, or with none, are gone through layer by layer.
    """
    features = policy.features_extractor
    assert isinstance(features, MissionAndImage)
    see = _image_features(features.image)
    mission = features.mission
    assert mission is None or isinstance(mission, nn.Linear)
    actor, critic = policy.mlp_extractor.policy_net, policy.mlp_extractor.value_net
    action_net, value_net = policy.action_net, policy.value_net
    assert isinstance(action_net, nn.Linear)
    assert isinstance(value_net, nn.Linear)

    def think(seen: Observation) -> Thoughts:
        with torch.no_grad():
            found = see(torch.as_tensor(seen["image"]))
            if mission is not None:
                found = torch.cat((found, _linear(mission, torch.as_tensor(seen["mission"]))))
            return _linear(action_net, _tanh_layers(actor, found)), _linear(value_net, _tanh_layers(critic, found))

    return think


def _image_features(eyes: nn.Module) -> Callable[[torch.Tensor], torch.Tensor]:
    """From uint8[channels, height, width] to the image's features."""
    convolutions = [layer for layer in eyes.modules() if isinstance(layer, nn.Conv2d)]
    if not convolutions or any(layer.padding != (0, 0) for layer in convolutions):
        return lambda image: eyes(image[None].float() / 255)[0]
    (last,) = (layer for layer in eyes.modules() if isinstance(layer, nn.Linear))
    # (rows x columns x channels, out), as patches lie in a picture of channels last; then side, stride and bias
    kernels = [
        (
            layer.weight.detach().permute(0, 2, 3, 1).reshape(layer.out_channels, -1).t(),
            int(layer.kernel_size[0]),
            int(layer.stride[0]),
            _bias(layer),
        )
        for layer in convolutions
    ]

    def see(image: torch.Tensor) -> torch.Tensor:
        x = image.permute(1, 2, 0).to(torch.float32, memory_format=torch.contiguous_format).div_(255)
        height, width, channels = x.shape
        for kernel, side, stride, bias in kernels:
            rows, columns, row = (height - side) // stride + 1, (width - side) // stride + 1, width * channels
            patches = x.as_strided((rows, columns, side, side * channels), (row * stride, channels * stride, row, 1))
            x = torch.addmm(bias, patches.reshape(rows * columns, -1), kernel).relu_()
            height, width, channels = rows, columns, len(bias)
        return _linear(last, x.t().reshape(-1)).relu_()

    return see


def _tanh_layers(layers: nn.Module, x: torch.Tensor) -> torch.Tensor:
    for layer in layers.children():
        x = _linear(layer, x) if isinstance(layer, nn.Linear) else x.tanh_()
    return x


def _linear(layer: nn.Linear, x: torch.Tensor) -> torch.Tensor:
    return torch.addmv(layer.bias, layer.weight, x)


def _bias(layer: nn.Conv2d) -> torch.Tensor:
    assert layer.bias is not None
    return layer.bias.detach()
