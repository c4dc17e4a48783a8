from io import BytesIO

import pytest
import torch
from skimage.io import imread

from kfit.reports.picture_table import picture_table


def shown(figure):
    file = BytesIO()
    figure.savefig(file, format="png")
    file.seek(0)
    return imread(file)[..., :3]


def test_columns_stand_beside_one_another_and_rows_below():
    red, white = torch.tensor([1.0, 0, 0])[:, None, None].expand(3, 20, 20), torch.ones(3, 20, 20)
    drawn = shown(picture_table({"one": torch.stack([red, white]), "two": torch.stack([white, red])}))
    coloured = (drawn[..., 0] > 250) & (drawn[..., 1] < 5)
    height, width = coloured.shape
    below = height - width  # what the names take
    upper, lower = coloured[below : below + width // 2], coloured[below + width // 2 :]
    shares = [half.mean() for part in (upper, lower) for half in (part[:, : width // 2], part[:, width // 2 :])]
    assert min(shares[0], shares[3]) > 0.85
    assert max(shares[1], shares[2]) < 0.02


def test_names_are_written_whole_above_and_beside():
    grey = torch.full((1, 1, 20, 20), 0.5)
    bare, named = shown(picture_table({"": grey})), shown(picture_table({"two\nlines": grey}, rows=["row"]))
    assert named.shape[0] > bare.shape[0]
    assert named.shape[1] > bare.shape[1]
    assert (named[0] == 255).all()  # no letter is cut off
    assert (named[:, 0] == 255).all()
    assert (named[: named.shape[0] - bare.shape[0]] < 100).any()


def test_pictures_of_one_channel_are_grey_on_the_whole_range():
    picture = torch.full((1, 1, 30, 60), 0.25)
    drawn = shown(picture_table({"": picture}))
    assert drawn[drawn.shape[0] // 2, drawn.shape[1] // 2].tolist() == pytest.approx([64] * 3, abs=1)
    assert drawn.shape[1] > 1.5 * drawn.shape[0]


def test_columns_that_do_not_go_together_are_an_error():
    with pytest.raises(ValueError, match="at least one column"):
        picture_table({})
    with pytest.raises(ValueError, match="'b': 2"):
        picture_table({"a": torch.ones(1, 3, 8, 8), "b": torch.ones(2, 3, 8, 8)})
    with pytest.raises(ValueError, match="'rows': 2"):
        picture_table({"a": torch.ones(1, 3, 8, 8)}, rows=["one", "two"])
