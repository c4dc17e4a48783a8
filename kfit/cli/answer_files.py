"""Files and lines that `kfit pose` makes of its answers."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from rich.table import Table

from kfit.pose import PoseResult
from kfit.reports import describe, draw_objects, draw_overlay
from kfit.reports.words import words_of
from kfit.runtime.atomic_write import atomic_write

VERSION = 2
Answers = Mapping[str, Sequence[PoseResult]]


def document(answers: Answers) -> dict[str, Any]:
    """What pose.json holds: a version, and a list of all objects, each with the name of its photo.

    Of one object alone its numbers stand at the top too, where version 1 had them.
    """
    objects = [{"photo": photo, **result.to_dict()} for photo, results in answers.items() for result in results]
    return {"version": VERSION, **(objects[0] if len(objects) == 1 else {}), "objects": objects}


def write(answers: Answers, folder: Path, others: Mapping[str, Callable[[Path], object]]) -> list[Path]:
    """Write pose.json, a picture of each photo and others by absolute path, all or none; the pictures' paths."""
    text = json.dumps(document(answers), indent=2) + "\n"
    pictures = {name: results for name, results in zip(_names(list(answers)), answers.values(), strict=True) if results}
    files: dict[str, Callable[[Path], object]] = {"pose.json": lambda path: path.write_text(text)}
    files |= {name: partial(_save, picture=picture(results)) for name, results in pictures.items()}
    written = atomic_write(folder, {**files, **others})
    return written[1 : 1 + len(pictures)]


def picture(results: Sequence[PoseResult]) -> NDArray[np.uint8]:
    """The photo with the poses of its objects; of one object also what was fitted."""
    if len(results) == 1:
        (result,) = results
        return draw_overlay(
            result.image,
            result.rotation,
            result.translation,
            result.size,
            result.intrinsics,
            observed=result.observation.field("image")[0],
            drawing=torch.from_numpy(result.drawing).movedim(-1, 0),
            mask=result.mask,
            caption=describe(result),
        )
    caption = "\n".join(f"{number}  {describe(result)}" for number, result in enumerate(results, 1))
    return draw_objects(results[0].image, [vars(result) for result in results], caption)


def table(answers: Answers) -> Table:
    """A row an object."""
    made = Table(box=None, pad_edge=False)
    for head in (["photo"] if len(answers) > 1 else []) + [
        "",
        "object",
        "box",
        "view",
        "size",
        "distance",
        "confidence",
    ]:
        made.add_column(head, no_wrap=head == "box", overflow="fold")
    for photo, results in answers.items():
        for number, result in enumerate(results, 1):
            words = words_of(result)
            score = "" if result.category_score is None else f" ({100 * result.category_score:.0f} %)"
            box = " ".join(map(str, result.bbox_xywh))
            name = [Path(photo).name] if len(answers) > 1 else []
            cells = (words.view, words.size, words.distance, words.confidence)
            made.add_row(*name, str(number), f"{words.name}{score}", box, *cells)
        if not results:
            made.add_row(Path(photo).name, "", "nothing found")
    return made


def _names(photos: Sequence[str]) -> list[str]:
    """Names of their pictures: overlay.png of one photo, else by the photos' names, numbered where those are equal."""
    if len(photos) == 1:
        return ["overlay.png"]
    names: list[str] = []
    for photo in photos:
        stem, number = Path(photo).stem, 1
        while f"{stem}_overlay.png" in names:
            number += 1
            stem = f"{Path(photo).stem}_{number}"
        names.append(f"{stem}_overlay.png")
    return names


def _save(path: Path, picture: NDArray[np.uint8]) -> None:
    Image.fromarray(picture).save(path)
