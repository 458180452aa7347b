"""The four networks of place feature learning, on bird-views with pixels in [−1, 1] (METHODS 5.2).

An encoder maps an image to a code, a decoder maps a code to an image; one discriminator scores
pairs of image and code, the other images alone. They follow the code of Yin et al., IROS 2018; the
game is BiGAN's (Donahue et al., 2017), also called ALI (Dumoulin et al., 2017).

In all networks `width` is the number of filters of the first convolution, the authors' 64; all
hidden layers scale with it. TensorFlow pads a stride of 2 by one pixel before and two behind; these
networks pad by two on each side, which gives the same shapes and counts.
"""

from copy import deepcopy
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

SIDE = 64
"""Pixels along a side of an image."""
Head = Literal["scalar", "vector"]
"""Whether an image's score is one number, or its 16 · width features, each of which is judged, as
in the authors' code."""


def halvings(width: int, channels: int) -> nn.Sequential:
    """Four convolutions that each halve the side of images (batch, channels, 64, 64).

    Their output is flat: (batch, 128 · width).
    """
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise((channels, width, 2 * width, 4 * width, 8 * width)):
        convolution = nn.Sequential(
            nn.Conv2d(inputs, outputs, 5, stride=2, padding=2), nn.BatchNorm2d(outputs)
        )
        layers += [convolution, nn.LeakyReLU(0.2, inplace=True)]
    return nn.Sequential(*layers, nn.Flatten())


def feature_layers(width: int, channels: int) -> nn.Sequential:
    """A discriminator's features (batch, 16 · width) of images (batch, channels, 64, 64)."""
    return nn.Sequential(
        halvings(width, channels),
        nn.Linear(128 * width, 16 * width),
        nn.BatchNorm1d(16 * width),
        nn.LeakyReLU(0.2),
    )


def initialise(net: nn.Module) -> None:
    """Initialise as the authors do: weights N(0, 0.02), batch norms N(1, 0.02), zero biases."""
    for layer in net.modules():
        if isinstance(layer, nn.BatchNorm1d | nn.BatchNorm2d):
            nn.init.normal_(layer.weight, 1.0, 0.02)
            nn.init.zeros_(layer.bias)
        elif isinstance(layer, nn.Conv2d | nn.ConvTranspose2d | nn.Linear):
            nn.init.normal_(layer.weight, 0.0, 0.02)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    net.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


class Encoder(nn.Module):
    """Codes (batch, code) of images (batch, channels, 64, 64).

    It has 8,503,296 numbers for three channels.
    """

    def __init__(self, width: int = 64, channels: int = 1, code: int = 512) -> None:
        super().__init__()
        self.halvings = halvings(width, channels)
        self.dense = nn.Linear(128 * width, code)
        initialise(self)

    def forward(self, images: Tensor) -> Tensor:
        images = images.to(self.dense.weight.dtype, memory_format=torch.channels_last)
        codes: Tensor = self.dense(self.halvings(images))
        return codes


class Decoder(nn.Module):
    """Images (batch, channels, 64, 64) in (−1, 1) of codes (batch, code).

    It has 8,510,467 numbers for three channels.
    """

    def __init__(self, width: int = 64, channels: int = 1, code: int = 512) -> None:
        super().__init__()
        self.dense = nn.Linear(code, 128 * width)
        self.norm = nn.BatchNorm2d(8 * width)
        layers: list[nn.Module] = [nn.ReLU()]
        for inputs, outputs in pairwise((8 * width, 4 * width, 2 * width, width)):
            layers += [doubling(inputs, outputs), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True)]
        self.doublings = nn.Sequential(*layers, doubling(width, channels), nn.Tanh())
        initialise(self)

    def forward(self, codes: Tensor) -> Tensor:
        # 128 · width numbers are 8 · width channels of 4 × 4 pixels.
        small = (
            self.dense(codes)
            .view(len(codes), -1, 4, 4)
            .contiguous(memory_format=torch.channels_last)
        )
        images: Tensor = self.doublings(self.norm(small))
        return images


def doubling(inputs: int, outputs: int) -> nn.ConvTranspose2d:
    """A transposed convolution that doubles the side of images."""
    return nn.ConvTranspose2d(inputs, outputs, 5, stride=2, padding=2, output_padding=1)


class ImageDiscriminator(nn.Module):
    """Scores of images: (batch, 1), or (batch, 16 · width) with the head `vector`.

    It has 12,700,160 numbers for three channels and the head `vector`.
    """

    def __init__(self, width: int = 64, channels: int = 1, head: Head = "scalar") -> None:
        super().__init__()
        self.features = feature_layers(width, channels)
        self.head: nn.Module = nn.Linear(16 * width, 1) if head == "scalar" else nn.Identity()
        initialise(self)

    def forward(self, images: Tensor) -> Tensor:
        scores: Tensor = self.head(
            self.features(images.contiguous(memory_format=torch.channels_last))
        )
        return scores


class JointDiscriminator(nn.Module):
    """Scores (batch, 1) of pairs of an image and a code: whether they belong together.

    It has 22,669,825 numbers for three channels. The output is linear; the authors' code has a
    leaky ReLU there, which would suppress negative scores.
    """

    def __init__(self, width: int = 64, channels: int = 1, code: int = 512) -> None:
        super().__init__()
        code_width = 16 * width
        joint_width = 32 * width
        self.features = feature_layers(width, channels)
        self.code = nn.Sequential(
            nn.Dropout(0.2),
            nn.Linear(code, code_width),
            nn.Dropout(0.2),
            nn.Linear(code_width, code_width),
        )
        self.head = nn.Sequential(
            nn.Dropout(0.2),
            nn.Linear(joint_width, joint_width),
            nn.LeakyReLU(0.2),
            nn.Dropout(0.2),
            nn.Linear(joint_width, joint_width),
            nn.LeakyReLU(0.2),
            nn.Dropout(0.2),
            nn.Linear(joint_width, 1),
        )
        initialise(self)

    def forward(self, images: Tensor, codes: Tensor) -> Tensor:
        features = self.features(images.contiguous(memory_format=torch.channels_last))
        scores: Tensor = self.head(torch.cat([features, self.code(codes)], 1))
        return scores


def folded(encoder: Encoder, weight_type: torch.dtype = torch.float32) -> Encoder:
    """A copy of an encoder that is faster, but cannot be trained, with weights of this type.

    Its batch norms are folded into the convolutions before them.
    """
    encoder = deepcopy(encoder).eval()
    for index, block in enumerate(encoder.halvings):
        if isinstance(block, nn.Sequential):
            encoder.halvings[index] = fuse_conv_bn_eval(*block)
    return encoder.to(weight_type)
