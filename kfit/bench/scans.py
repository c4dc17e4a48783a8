"""Meshes to measure a model on: which category each is of, and views of them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from kfit.bench.held_out_views import Corruption, HeldOutViews, views_of
from kfit.bench.view_cameras import ViewsOf
from kfit.data import Light, Mesh
from kfit.data.exposure import with_exposure
from kfit.data.mesh_places import MeshFile, find_mesh_files
from kfit.pose.category_model import CategoryModel


def find_scans(places: str | Sequence[str], categories: Collection[str]) -> tuple[list[MeshFile], list[Path]]:
    """Meshes of known categories, and paths of meshes of unknown category.

    A mesh is of the category that stands before its place, else of the one that its file or the innermost of its
    folders names as a whole word (``ycb/025_mug/textured.obj``: mug). Where there is one category alone, it is of that.

    Args:
        places: as `kfit.data.mesh_places.find_mesh_files` takes them.
        categories: those that are measured, or known at all.

    Raises:
        FileNotFoundError, ValueError: for a place that is none, or holds no mesh.
    """
    known, unknown = [], []
    for file in find_mesh_files(places, categories):
        only = next(iter(categories)) if len(categories) == 1 else None
        named = file.category or _named(file.path.absolute(), categories) or only
        if named is None:
            unknown.append(file.path)
        else:
            known.append(replace(file, category=named))
    return known, unknown


def _named(path: Path, categories: Collection[str]) -> str | None:
    for part in (path.stem, *reversed(path.parent.parts)):
        words = re.split("[^a-z]+", part.lower())
        found = [name for name in categories if name.lower() in words]
        if found:
            return found[0]
    return None


def scan_views(
    model: CategoryModel,
    scan: MeshFile,
    num_views: int,
    seed: int = 0,
    kind: ViewsOf = "upright",
    corruption: Corruption | None = None,
) -> HeldOutViews:
    """Views of one mesh as `kfit.bench.held_out_views.views_of` draws them, each in a random light of its own."""
    return views_of(model, mesh_objects([scan], num_views, seed), seed, kind=kind, corruption=corruption)


def mesh_objects(files: Sequence[MeshFile], count: int, seed: int) -> Iterator[tuple[Mesh, Light]]:
    """``count`` objects of mesh files, one file after the other, each in a random light of its own."""
    meshes: dict[MeshFile, Mesh] = {}
    for number in range(count):
        file = files[number % len(files)]
        if file not in meshes:
            meshes[file] = with_exposure(file.mesh(), two_sided=None)
        yield meshes[file], Light.random(np.random.default_rng([seed, number, 1]))
