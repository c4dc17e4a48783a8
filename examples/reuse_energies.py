"""kfit's energies in another task: restore a noisy photo by descending on pixels, no pipeline involved."""

import sys

import torch
from skimage import data
from skimage.io import imsave

from kfit.energies import L2, SSIM, Perceptual
from kfit.features import EfficientNetLite0

clean = torch.from_numpy(data.astronaut()[:256, 96:352] / 255.0).float().permute(2, 0, 1)[None]
noisy = (clean + 0.2 * torch.randn(clean.shape, generator=torch.Generator().manual_seed(0))).clamp(0, 1)

# Each energy gives one number a picture, takes gradients, and compares any two tensors.
for name, energy in {"L2": L2(), "SSIM": SSIM(), "perceptual": Perceptual(EfficientNetLite0())}.items():
    print(
        f"{name:>10}: noisy against clean {float(energy(noisy, clean)):.4f}, clean against itself "
        f"{float(energy(clean, clean)):.4f}"
    )

# What the target's side costs is paid once.
energy = SSIM()
prepared = energy.prepare(clean)
picture = noisy.clone().requires_grad_()
optimizer = torch.optim.Adam([picture], lr=0.03)
for _ in range(30):
    optimizer.zero_grad()
    energy.compare(picture, prepared).sum().backward()
    optimizer.step()
restored = picture.detach()
print(f"SSIM energy from {float(energy(noisy, clean)):.3f} to {float(energy(restored, clean)):.3f} in 30 steps")

panels = torch.cat([noisy[0], restored[0], clean[0]], 2).clamp(0, 1)
path = sys.argv[1] if len(sys.argv) > 1 else "reuse_energies.png"
imsave(path, (255 * panels.permute(1, 2, 0)).byte().numpy(), check_contrast=False)
print(f"noisy, descended and clean: {path}")
