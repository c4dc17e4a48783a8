"""How fast a data set is fitted: the figures, and a run of two photos."""

from __future__ import annotations

import pytest
from jsonargparse import Namespace

from kfit.bench import dataset as bench_dataset
from kfit.cli.main import main


def test_the_first_batch_is_counted_apart():
    args = Namespace(objects=30, batch_size=10)
    first, rate, each, whole = bench_dataset.figures([5.0, 6.0, 7.0], args)
    assert (first, rate, each) == ("5.0", "10.00", "100.0")
    assert float(whole) == pytest.approx((5 + (15_573 - 10) / 10) / 60, abs=0.05)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*LeafSpec")
def test_a_folder_is_drawn_fitted_and_evaluated(tmp_path, capsys):
    words = ["--objects", "2", "--precisions", "[32-true]", "--out", str(tmp_path)]
    main(["bench", "dataset", "--category", "can", *words])
    page = (tmp_path / "README.md").read_text()
    row = next(line for line in page.splitlines() if line.startswith("| 32-true"))
    assert row.endswith("100 % |")  # cans that were found within ten degrees
    assert page.splitlines()[2].startswith("Made by `kfit bench dataset --category can --objects 2")
    with pytest.raises(SystemExit):
        main(["bench", "dataset", "--objects", "3", "--batch-size", "3"])
    assert "--objects must be more than one batch" in capsys.readouterr().err
