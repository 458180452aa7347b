"""Tests of PFL's four networks: their numbers counted by hand (METHODS 5.2), and the encoder as it
is used for answers."""

import pytest
import torch
from torch import nn

from pipeline.methods.pfl.bigan import (
    Decoder,
    Encoder,
    ImageDiscriminator,
    JointDiscriminator,
    folded,
)


def trained(net: nn.Module) -> int:
    return sum(value.numel() for value in net.parameters())


def test_the_authors_networks_have_their_numbers_and_hidden_layers_scale_with_the_width() -> None:
    # Convolutions 3·64, 64·128, 128·256, 256·512 of 25 taps and their biases, and two numbers a
    # channel for each batch norm: 4,864 + 204,928 + 819,456 + 3,277,312 + 1,920 = 4,308,480. Dense
    # 8192 → 512: 4,194,816. The image discriminator's dense 8192 → 1024 and batch norm: 8,389,632 +
    # 2,048.
    with torch.device("meta"):
        assert trained(Encoder(64, 3)) == 4_308_480 + 4_194_816 == 8_503_296
        assert trained(Decoder(64, 3)) == 8_510_467
        assert trained(ImageDiscriminator(64, 3, "vector")) == 4_308_480 + 8_391_680 == 12_700_160
        assert trained(ImageDiscriminator(64, 3)) == 12_700_160 + 1024 + 1
        assert trained(JointDiscriminator(64, 3)) == 22_669_825
        # One channel at width 8: 208 + 3,216 + 12,832 + 51,264 and 240 of the batch norms, then
        # 1024 → 512.
        assert trained(Encoder(8)) == 208 + 3_216 + 12_832 + 51_264 + 240 + 1024 * 512 + 512
        assert trained(ImageDiscriminator(8)) == 67_760 + 1024 * 128 + 128 + 2 * 128 + 129


def test_images_and_codes_have_their_shapes() -> None:
    images = torch.rand(3, 1, 64, 64) * 2 - 1
    codes = torch.randn(3, 20)
    assert Encoder(2, code=20)(images).shape == (3, 20)
    made = Decoder(2, code=20)(codes)
    assert made.shape == (3, 1, 64, 64)
    assert made.abs().max() < 1
    assert ImageDiscriminator(2)(images).shape == (3, 1)
    assert ImageDiscriminator(2, head="vector")(images).shape == (3, 32)
    assert JointDiscriminator(2, code=20)(images, codes).shape == (3, 1)
    assert Decoder(2, channels=3, code=20)(codes).shape == (3, 3, 64, 64)


def test_weights_start_as_the_authors_do() -> None:
    torch.manual_seed(0)
    for net in (Encoder(8), Decoder(8), JointDiscriminator(8)):
        for layer in net.modules():
            if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d | nn.Linear):
                if layer.weight.numel() > 2000:
                    assert float(layer.weight.detach().std()) == pytest.approx(0.02, rel=0.1)
                assert layer.bias is not None
                assert not layer.bias.any()
            if isinstance(layer, nn.BatchNorm2d | nn.BatchNorm1d):
                assert float(layer.weight.detach().mean()) == pytest.approx(1, abs=0.02)
                assert 0 < float(layer.weight.detach().std()) < 0.04


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    """With running statistics that are not those of the start."""
    torch.manual_seed(1)
    net = Encoder(4, code=16)
    for _ in range(3):
        net(torch.rand(8, 1, 64, 64) * 2 - 1)
    return net.eval()


def test_folding_changes_no_code(encoder: Encoder) -> None:
    images = torch.rand(3, 1, 64, 64)
    quick = folded(encoder)
    assert not any(isinstance(layer, nn.BatchNorm2d) for layer in quick.modules())
    with torch.inference_mode():
        torch.testing.assert_close(quick(images), encoder(images), atol=1e-5, rtol=1e-4)
    assert any(isinstance(layer, nn.BatchNorm2d) for layer in encoder.modules())
