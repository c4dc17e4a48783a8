"""Train a small network to take noise off photos, by kfit's energies and by the mean absolute difference alone.

    python examples/train_denoiser.py [FOLDER] [STEPS]

Writes FOLDER/train_denoiser.png, measured by scikit-image on another photo. FOLDER is kfit_out, STEPS 200 by default.
"""

import sys
from pathlib import Path

import torch
from skimage import data, metrics
from torch import nn

from kfit import Energy
from kfit.energies import L1, SSIM, Perceptual
from kfit.features import EfficientNetLite0
from kfit.reports.picture_table import picture_table

NOISE, NUM_STEPS = 0.15, int(sys.argv[2]) if len(sys.argv) > 2 else 200
more: dict[Energy, float] = {SSIM(): 0.3, Perceptual(EfficientNetLite0([1, 3])): 0.02}
losses: dict[str, dict[Energy, float]] = {"L1 alone": {L1(): 1.0}, "L1 + SSIM + Perceptual": {L1(): 1.0, **more}}
photos = [data.coffee(), data.cat(), data.rocket(), data.astronaut()]
*known, unknown = (torch.from_numpy(photo).movedim(-1, 0) / 255 for photo in photos)
patches = torch.cat([photo.unfold(1, 48, 24).unfold(2, 48, 24).flatten(1, 2).movedim(1, 0) for photo in known])


def trained(loss: dict[Energy, float]) -> nn.Module:
    """Train a network that draws a picture's noise; start and patches are the same whatever the loss."""
    torch.manual_seed(0)
    hidden = [layer for _ in range(2) for layer in (nn.Conv2d(16, 16, 3, padding=1), nn.ReLU())]
    network = nn.Sequential(nn.Conv2d(3, 16, 3, padding=1), nn.ReLU(), *hidden, nn.Conv2d(16, 3, 3, padding=1))
    optimizer = torch.optim.Adam(network.parameters())
    rates = torch.optim.lr_scheduler.OneCycleLR(optimizer, 0.01, NUM_STEPS)
    for _ in range(NUM_STEPS):
        truth = patches[torch.randint(len(patches), (6,))]
        noisy = truth + NOISE * torch.randn(truth.shape)
        optimizer.zero_grad()
        torch.autograd.backward([w * energy(noisy - network(noisy), truth).mean() for energy, w in loss.items()])
        optimizer.step()
        rates.step()
    return network.requires_grad_(False)


truth = unknown[None, :, :192, 128:320]
noisy = truth + NOISE * torch.randn(truth.shape, generator=torch.Generator().manual_seed(1))
columns = {}
for name, picture in {"noisy": noisy, **{name: noisy - trained(loss)(noisy) for name, loss in losses.items()}}.items():
    a, b = (one[0].clamp(0, 1).movedim(0, -1).numpy() for one in (truth, picture))
    similar = metrics.structural_similarity(a, b, channel_axis=-1, data_range=1)
    figures = f"PSNR {metrics.peak_signal_noise_ratio(a, b):.2f} dB, SSIM {similar:.3f}"
    print(f"{name}: {figures}")
    columns[f"{name}\n{figures}"] = picture
detail = nn.Upsample(scale_factor=3)  # a ninth of each picture, below it
columns = {k: torch.cat([one, detail(one[..., 64:128, 64:128])]) for k, one in (columns | {"truth": truth}).items()}
path = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out") / "train_denoiser.png"
path.parent.mkdir(parents=True, exist_ok=True)
picture_table(columns).savefig(path)
print(path)
