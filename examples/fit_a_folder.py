"""Fit a whole folder of photos, shared by two processes.

    python examples/fit_a_folder.py [FOLDER]

Makes FOLDER/photos (mug0.jpg, mug0_mask.png, …), fits it by `lightning predict` into FOLDER/poses (mug0.json, …), and
writes FOLDER/fit_a_folder.png, a sheet of all answers. FOLDER is kfit_out by default. The same
command resumes an interrupted run, and no photo is fitted twice.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

from PIL import Image
from skimage.io import imread, imsave
from skimage.util import img_as_ubyte, montage

import kfit
from kfit.bench.held_out_views import held_out_views
from kfit.reports import draw_overlay

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "kfit_out")
photos, poses = folder / "photos", folder / "poses"

# Six procedural mugs that the model has never seen stand for photos; each has its mask beside it. The files tell the
# lens as a camera's do, by EXIF tag 0xA405: the focal length, were the sensor as large as film.
photos.mkdir(parents=True, exist_ok=True)
views = held_out_views(kfit.load("mug"), num_views=6, seed=6)
lens = Image.Exif()
lens[0xA405] = round(float(views.intrinsics[0, 0, 0]) * math.hypot(36, 24) / math.hypot(*views.masks[0].shape))
for number, (photo, mask) in enumerate(zip(views.photos, views.masks, strict=True)):
    Image.fromarray(img_as_ubyte(photo)).save(photos / f"mug{number}.jpg", exif=lens, quality=95)
    Image.fromarray(img_as_ubyte(mask > 0.5)).save(photos / f"mug{number}_mask.png")

# A process computes with one thread, so on a CPU one starts one a core.
recipe = Path(__file__).parents[1] / "recipes" / "fit_dataset.yaml"
words = f"--data kfit.batch.photo_folder.PhotoFolder --data.category mug --data.root {photos} --model.out {poses} "
words += "--trainer.accelerator cpu --trainer.strategy ddp --trainer.devices 2"
subprocess.run([sys.executable, "-m", "kfit", "predict", "-c", recipe, *words.split()], check=True)

pictures = []
for number in range(len(views.photos)):
    found = json.loads((poses / f"mug{number}.json").read_text())
    rotation, translation, size, camera = (found[k] for k in ("rotation", "translation", "size", "intrinsics"))
    caption = f"mug{number}: {100 * found['translation'][2]:.0f} cm away, confidence {100 * found['confidence']:.0f} %"
    photo = imread(photos / f"mug{number}.jpg") / 255
    pictures.append(draw_overlay(photo, rotation, translation, size, camera, caption=caption))
path = folder / "fit_a_folder.png"
imsave(path, montage(pictures, grid_shape=(2, 3), channel_axis=-1))
print(path)
