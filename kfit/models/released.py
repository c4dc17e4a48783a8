"""The authors' released checkpoints, read as kfit's networks (neural_object_fitting@7309348)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from kfit.core import Variables
from kfit.core.check import check_shape
from kfit.generators import VAE3D, ConvEncoder
from kfit.geometry import azimuth_from_released
from kfit.runtime.torch_file import read_torch

# The released names of the layers, in the order of kfit's.
LIFTS, DECODES = ("enc_1.0", "enc_2.0"), ("enc_3.0", "enc_4.0")
CONVOLUTIONS, LINEARS = ("model.0", "model.2", "model.5", "model.8"), ("enc_out.0", "enc_out.2")
# Number of voxels or pixels of each of their normalisations.
COUNTS = (4**3, 8**3, 16**3, 32**2, 64**2)


def load_released(path: str | Path) -> tuple[VAE3D, ConvEncoder]:
    """Read a released ``model_latest.pth``: generator and encoder, in evaluation mode.

    Pictures and codes equal the released code's to 1e-4. Pictures are in [0, 1], kfit's range, not in [−1, 1]; the
    generator draws no mask, like theirs. `released_values` converts their variables to kfit's.

    The object has NOCS's axes; in the released code it is rotated by 90° about y, see
    `kfit.geometry.azimuth_from_released`.

    The weights are converted once. The learned volume and the kernels that enlarge it are rotated by those 90°. Their
    tanh is 2σ(2x) − 1, so the last layer is doubled. Their standard deviation is the unbiased one, so the style's
    deviations are multiplied by √((n − 1)/n). Their grid rotates the volume by Ry(azimuth) · Rx(elevation) with y down,
    which is kfit's elevation with the volume's depth reversed, and the opposite azimuth. Their convolutions of stride 1
    are transposed ones. The weights are divided by the spectral norm uᵀWv.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not such a checkpoint.

    Example:
        >>> from kfit.models import load_released
        >>> generator, encoder = load_released("model_latest.pth")
        Traceback (most recent call last):
        FileNotFoundError: no checkpoint at model_latest.pth
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no checkpoint at {path}")
    wrong = f"{path} is no released checkpoint, that is {{'netG': …, 'netE': …}} of neural_object_fitting"
    try:
        saved = read_torch(path)
        theirs_g, theirs_e = dict(saved["netG"]), dict(saved["netE"])
    except (ValueError, TypeError, KeyError, IndexError) as error:
        raise ValueError(f"{wrong}: {error}") from None
    try:
        numbers_g, numbers_e = _generator(theirs_g), _encoder(theirs_e)
        code_dim = theirs_g["mlp0.fc.weight"].shape[1]
        sizes = released_sizes(code_dim)
        generator, encoder = VAE3D(**sizes["generator"]), ConvEncoder(**sizes["encoder"])
        generator.load_state_dict(numbers_g)
        encoder.load_state_dict(numbers_e)
    except KeyError as error:
        raise ValueError(f"{wrong}: it lacks {error}") from None
    except (RuntimeError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(f"{wrong}: its shapes are others: {' '.join(str(error).split())}") from None
    return generator.eval(), encoder.eval()


def released_sizes(code_dim: int) -> dict[str, dict[str, Any]]:
    """Return the arguments of `VAE3D` and `ConvEncoder` for the released sizes, by the networks' names."""
    generator = {"volume_dims": [512, 128, 64], "projection_dim": 1024, "decoder_dims": [256, 64]}
    return {
        "generator": {"code_dim": code_dim, **generator, "rectified": True, "mask": False},
        "encoder": {
            "code_dim": code_dim,
            "channels": [64, 128, 256, 512],
            "tint_grid": 0,
            "instance_norm": True,
            "bounded": True,
        },
    }


def released_values(
    z: Tensor, elevation_deg: Tensor, azimuth_deg: Tensor, angle: Tensor, tx: Tensor, ty: Tensor, scale: Tensor
) -> Variables:
    """Convert the released code's numbers to the variables of `kfit.generators.SimilarityWarp` around its generator.

    `kfit.geometry.to_opencv` of the rotation by these angles is that of the released eval.py: NOCS's. For the azimuth
    see `kfit.geometry.azimuth_from_released`. The released shift is applied before rotation and scaling, along −x and
    y, and the released scale is the inverse of kfit's. At the border of the picture the released warp switches to white
    where kfit's blends over half a pixel.

    Args:
        z: (N, D) code.
        elevation_deg, azimuth_deg: (N,).
        angle: (N,) radians.
        tx, ty: (N,) in half-widths between the centres of the outer pixels, of pictures 64 wide.
        scale: (N,) above 0.

    Example:
        >>> import torch
        >>> from kfit.models import released_values
        >>> zero = torch.zeros(1)
        >>> released_values(torch.zeros(1, 16), zero, zero, zero, zero, zero, torch.tensor([2.0]))["scale"]
        tensor([0.5000])
    """
    check_shape("z", z, ("N", "D"))
    numbers = {"elevation_deg": elevation_deg, "azimuth_deg": azimuth_deg, "angle": angle, "tx": tx, "ty": ty}
    for name, value in (numbers | {"scale": scale}).items():
        check_shape(name, value, (z.shape[0],))
    cos, sin = angle.cos(), angle.sin()
    # Their grid maps to the source, p ↦ scale · (R p + t) with y down; kfit's is the inverse.
    shift = torch.stack([-(cos * tx + sin * ty), cos * ty - sin * tx], -1) * (63 / 64)
    return {
        "code": z,
        "azimuth": azimuth_from_released(azimuth_deg.deg2rad()),
        "elevation": elevation_deg.deg2rad(),
        "roll": angle,
        "shift": shift,
        "scale": 1 / scale,
    }


def _generator(theirs: dict[str, Tensor]) -> dict[str, Tensor]:
    ours = {"constant": _in_nocs_axes(theirs["shape_code"])}
    for index, name in enumerate(LIFTS):
        ours[f"lift.{index}.weight"] = _in_nocs_axes(theirs[f"{name}.weight"])
        ours[f"lift.{index}.bias"] = theirs[f"{name}.bias"]
    # (C · D, out) → (out, C · D), each channel's depths reversed.
    project = theirs["proj.0.weight"][:, :, 0, 0].unflatten(0, (-1, 16)).flip(1).flatten(0, 1).T
    ours |= {"project.weight": project[:, :, None, None], "project.bias": theirs["proj.0.bias"]}
    for index, name in enumerate(DECODES):
        ours |= {f"decode.{index}.weight": theirs[f"{name}.weight"], f"decode.{index}.bias": theirs[f"{name}.bias"]}
    ours |= {
        "draw.weight": 2 * theirs["enc_5.0.weight"].transpose(0, 1).flip(2, 3),
        "draw.bias": 2 * theirs["enc_5.0.bias"],
    }
    for index, count in enumerate(COUNTS):
        for part in ("weight", "bias"):
            mean, std = theirs[f"mlp{index}.fc.{part}"].chunk(2)
            ours[f"styles.{index}.affine.{part}"] = torch.cat([mean, std * ((count - 1) / count) ** 0.5])
    return ours


def _in_nocs_axes(volume: Tensor) -> Tensor:
    """Reverse the depth of a volume or kernel (…, …, D, H, W) and rotate it by 90° about y."""
    return volume.flip(2).rot90(-1, (2, 4))


def _encoder(theirs: dict[str, Tensor]) -> dict[str, Tensor]:
    ours: dict[str, Tensor] = {}
    names = {f"features.{name.removeprefix('model.')}": name for name in CONVOLUTIONS}
    names |= {f"output.{name.removeprefix('enc_out.')}": name for name in LINEARS}
    for own, name in names.items():
        weight = theirs[f"{name}.weight_orig"]
        sigma = theirs[f"{name}.weight_u"] @ weight.flatten(1) @ theirs[f"{name}.weight_v"]
        ours |= {f"{own}.weight": weight / sigma, f"{own}.bias": theirs[f"{name}.bias"]}
    return ours
