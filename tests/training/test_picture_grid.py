"""Grids of pictures: what they show, and that every logger that takes pictures gets them."""

import io

import pytest
import torch
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.loggers import CometLogger, CSVLogger, MLFlowLogger, TensorBoardLogger
from skimage.io import imread
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.utils.data import DataLoader

from kfit.core import Rendering
from kfit.training import PictureGrid

SIDE = 8
pytestmark = pytest.mark.filterwarnings(
    "ignore:.*does not have many workers", r"ignore:`isinstance\(treespec, LeafSpec\)` is deprecated:FutureWarning"
)


class Tilted(LightningModule):
    """Draws what it saw, darker the more the azimuth is."""

    def __init__(self):
        super().__init__()
        self.level = torch.nn.Parameter(torch.ones(()))

    def forward(self, image, azimuth, elevation):
        return Rendering(image / (1 + azimuth.view(-1, 1, 1, 1)))

    def training_step(self, batch, batch_idx):
        return self.level.square()

    def validation_step(self, batch, batch_idx):
        pass

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), 0.1)


def batch():
    rng = torch.Generator().manual_seed(0)
    pictures = {name: torch.rand(4, 3, SIDE, SIDE, generator=rng) for name in ("source", "target")}
    return pictures | {"azimuth": torch.zeros(4), "elevation": torch.zeros(4)}


def run(tmp_path, grid, logger, epochs=1):
    silent = dict.fromkeys(("enable_checkpointing", "enable_progress_bar", "enable_model_summary"), False)
    trainer = Trainer(
        max_epochs=epochs, log_every_n_steps=1, accelerator="cpu", default_root_dir=tmp_path, logger=logger,
        callbacks=[grid], **silent,
    )  # fmt: skip
    sample = DataLoader([batch()], batch_size=None)
    trainer.fit(Tilted(), sample, sample)


def check(picture, rows):
    """Source, target, reconstruction and two views a row."""
    assert picture.shape == (len(rows) * SIDE, 5 * SIDE, 3)
    sample = batch()
    shown = [sample["source"], sample["target"], sample["source"], sample["source"], sample["source"] / (1 + torch.pi)]
    for row, number in enumerate(rows):
        for column, pictures in enumerate(shown):
            tile = picture[row * SIDE : (row + 1) * SIDE, column * SIDE : (column + 1) * SIDE]
            assert (tile == (pictures[number] * 255).round().byte().permute(1, 2, 0).numpy()).all()


@pytest.mark.parametrize("logger", [CSVLogger, False])
def test_where_no_logger_takes_pictures_files_hold_a_row_an_object(tmp_path, logger):
    run(tmp_path, PictureGrid(3, 2), logger and logger(tmp_path, "", ""), epochs=2)
    assert sorted(path.name for path in tmp_path.rglob("*.png")) == ["epoch_000.png", "epoch_001.png"]
    check(imread(tmp_path / "pictures" / "epoch_001.png"), rows=(0, 1, 3))


def test_fewer_rows_are_shown_where_there_are_fewer_pictures(tmp_path):
    run(tmp_path, PictureGrid(9, 2), False)
    check(imread(tmp_path / "pictures" / "epoch_000.png"), rows=(0, 1, 2, 3))


def test_tensorboard_gets_the_pictures_and_no_file_is_written_beside_it(tmp_path):
    loggers = [CSVLogger(tmp_path, "", ""), TensorBoardLogger(tmp_path, "", "")]
    run(tmp_path, PictureGrid(3, 2), loggers, epochs=2)
    log = EventAccumulator(str(tmp_path)).Reload()
    first, second = log.Images("pictures")
    assert (first.step, second.step) == (1, 2)
    check(imread(io.BytesIO(second.encoded_image_string)), rows=(0, 1, 3))
    assert not list(tmp_path.rglob("*.png"))


class Client:
    """Stands for a logger's client: keeps what it is told."""

    def __init__(self):
        self.calls = []

    def log_image(self, *args, **settings):
        self.calls.append((args, settings))

    add_image = log_image


@pytest.mark.parametrize("name", ["MLflow", "Comet", "Weights & Biases", "own"])
def test_other_loggers_get_the_pictures_in_their_own_way(tmp_path, name):
    logger = Client()

    class Own(CSVLogger):
        @property
        def experiment(self):
            writer = super().experiment
            writer.log_image, writer.add_image = logger.log_image, logger.add_image
            return writer

    class MLflow(Own):
        __class__ = MLFlowLogger
        run_id = "r1"

    class Comet(Own):
        __class__ = CometLogger

    class WeightsAndBiases(CSVLogger):
        def log_image(self, key, images, step):
            logger.log_image(key, *images, step)

    kinds = {"MLflow": MLflow, "Comet": Comet, "Weights & Biases": WeightsAndBiases, "own": Own}
    run(tmp_path, PictureGrid(2, 2), kinds[name](tmp_path, "", ""))
    ((inputs, settings),) = logger.calls
    (pixels,) = (value for value in inputs if hasattr(value, "shape"))
    check(pixels, rows=(0, 3))
    others = [value for value in inputs if value is not pixels]
    assert (others, settings) == {
        "MLflow": (["r1"], {"key": "pictures", "step": 1}),
        "Comet": ([], {"name": "pictures", "step": 1}),
        "Weights & Biases": (["pictures", 1], {}),
        "own": (["pictures", 1], {"dataformats": "HWC"}),
    }[name]
    assert not list(tmp_path.rglob("*.png"))
