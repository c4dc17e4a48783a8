import pytest
import torch

from kfit import FitPipeline
from kfit.bench import optimizers as bench_optimizers
from kfit.bench import registration as bench_registration
from kfit.bench import registration_pairs
from kfit.cli.main import main
from kfit.generators import Template
from kfit.optimizers import LevenbergMarquardt


@pytest.mark.slow
def test_registration_prints_a_table_and_who_is_more_accurate(capsys, tmp_path):
    main(["bench", "registration", "--pictures", "[coffee,coins]", "--size", "96", "--out", str(tmp_path)])
    assert "| median of all |" in (tmp_path / "README.md").read_text()
    printed = capsys.readouterr().out
    assert "ECC, no blur" in printed
    assert "floor" in printed
    assert "kfit is at least as accurate as Kornia on 2 of 2 pairs: nearer by more than the floor on 2" in printed


def test_rivals_are_compared_by_the_floor_and_by_the_median_of_draws():
    ours, theirs, floor = [0.1, 0.2, 0.2, 0.3], [0.4, 0.1, 0.25, 0.2], [0.08] * 4
    sentence = (
        "kfit is at least as accurate as ECC on 2 of 4 pairs: nearer by more than the floor on 1, further by more"
    )
    sentence += " than it on 2; it loses 0 (off by over 1 pixel) that ECC finds"
    assert bench_registration.compared(ours, theirs, floor, "ECC", 1) == sentence
    sentence += "; by the median of 2 draws on 1 of 2 pictures"
    assert bench_registration.compared(ours, theirs, floor, "ECC", 2) == sentence


def test_a_pair_that_only_the_rival_finds_is_counted_as_lost():
    compared = bench_registration.compared([0.1, 3.0, 3.0], [0.2, 0.5, 9.0], [0.1] * 3, "ECC", 1)
    assert "it loses 1 (off by over 1 pixel) that ECC finds" in compared


def test_a_pair_is_the_same_scene_under_its_map():
    pair = registration_pairs.make_pair("coffee", 96, 0.0, 3)
    assert registration_pairs.corner_distance(pair.truth, pair) == 0
    assert registration_pairs.corner_distance(torch.eye(3), pair) > 2


def test_a_registration_without_noise_comes_within_a_hundredth_of_a_pixel():
    pair = registration_pairs.make_pair("coffee", 96, 0.0, 3)
    found = registration_pairs.corner_distance(bench_registration.register(pair), pair)
    assert found < 0.01
    assert found < registration_pairs.corner_distance(bench_registration.by_ecc(pair, blur=1), pair)


def test_the_floor_is_how_far_noise_spreads_the_answers_of_least_squares():
    # What is drawn by the template itself, so that the noise is all there is; one Gauss–Newton step from the truth.
    pair, noise = registration_pairs.make_pair("coffee", 64, 0.0, 3), 0.02
    template = Template(pair.template.double(), oversampling=4)
    corners = template.corners(pair.truth[None])
    steps = 1e-4 * torch.eye(8, dtype=torch.float64).view(8, 4, 2)
    drawn = [pair.gain * template(corners=corners + s * steps).image for s in (1, -1)]
    slopes = (drawn[0] - drawn[1]) / 2e-4
    light = torch.stack([template(corners=corners).image[0], torch.ones_like(slopes[0])])
    inside = registration_pairs.inside(template, corners).expand_as(slopes[:1]).flatten() > 0
    jacobian = torch.cat([slopes, light]).flatten(1)[:, inside].T
    rng = torch.Generator().manual_seed(0)
    noises = noise * torch.randn(len(jacobian), 400, generator=rng, dtype=torch.float64)
    moved = 32 * torch.linalg.lstsq(jacobian, noises).solution[:8].view(4, 2, 400)
    deviation = float(moved.square().sum(1).mean().sqrt())
    assert registration_pairs.noise_floor(pair, noise) == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["registration", "--pictures", "[eagle]"], "unknown eagle; known are astronaut"),
        (["registration", "--size", "100"], "--size must be a multiple of 8"),
        (["registration", "--draws", "0"], "--draws must be at least 1"),
        (["optimizers", "--budget", "0"], "--budget must be at least 1"),
        (["optimizers", "--category", "teapot", "--problems", "1"], "no bundled model"),
    ],
)
def test_a_mistake_gets_one_sentence(words, message, capsys):
    with pytest.raises(SystemExit):
        main(["bench", *words])
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_optimizers_prints_a_line_for_each_optimizer_and_problem(capsys):
    main(["bench", "optimizers", "--problems", "1", "--starts", "1", "--budget", "4"])
    printed = capsys.readouterr().out
    for name in ("Adam", "AutoAdam", "LBFGS", "LevenbergMarquardt", "CMAES", "Stages"):
        assert printed.count(name) >= 4
    for problem in ("astronaut", "coffee", "pose", "inversion"):
        assert problem in printed


def test_a_registration_is_solved_when_it_is_and_not_before():
    problem = bench_optimizers.registration("coffee", 3, seed=0)
    for steps, solved in ((0, False), (15, True)):
        fit = FitPipeline(
            problem.generator,
            problem.energies,
            problem.initializers,
            LevenbergMarquardt(),
            num_starts=3,
            num_steps=steps,
        )
        assert problem.solved(fit(problem.observation, seed=0)).tolist() == [solved] * 3


@pytest.mark.slow
def test_simpleitk_and_ecc_find_affine_maps_and_kfit_comes_as_near():
    pytest.importorskip("SimpleITK")
    pair = registration_pairs.make_pair("coffee", 96, 0.0, 3, "affine")
    ours = registration_pairs.corner_distance(bench_registration.register(pair, "affine"), pair)
    theirs = (bench_registration.by_simpleitk(pair), bench_registration.by_ecc(pair, 1, "affine"))
    distances = [registration_pairs.corner_distance(matrix, pair) for matrix in theirs]
    assert max(distances) < 0.5
    assert ours < min(distances)


def test_an_affine_map_has_a_lower_floor_than_a_homography():
    pair = registration_pairs.make_pair("coffee", 64, 0.0, 3, "affine")
    assert registration_pairs.noise_floor(pair, 0.02, "affine") < 0.9 * registration_pairs.noise_floor(pair, 0.02)
