import pytest
import torch

from kfit import FitPipeline
from kfit.cli import bench_optimizers, bench_registration
from kfit.cli.main import main
from kfit.optimizers import LevenbergMarquardt


def test_registration_prints_a_table_and_who_is_more_accurate(capsys):
    main(["bench", "registration", "--pictures", "[coffee,coins]", "--size", "96"])
    said = capsys.readouterr().out
    assert "ECC" in said
    assert "kfit is at least as accurate as Kornia on 2 of 2" in said


def test_a_pair_is_the_same_scene_under_its_map():
    pair = bench_registration.make_pair("coffee", 96, 0.0, 3)
    assert bench_registration.corner_distance(pair.truth, pair) == 0
    assert bench_registration.corner_distance(torch.eye(3), pair) > 2
    assert bench_registration.corner_distance(bench_registration.register(pair), pair) < 0.1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["registration", "--pictures", "[eagle]"], "unknown eagle; known are astronaut"),
        (["registration", "--size", "100"], "--size must be a multiple of 8"),
        (["optimizers", "--budget", "0"], "--budget must be at least 1"),
        (["optimizers", "--category", "teapot", "--problems", "1"], "no bundled model"),
    ],
)
def test_a_mistake_gets_one_sentence(words, said, capsys):
    with pytest.raises(SystemExit):
        main(["bench", *words])
    assert said in capsys.readouterr().err


def test_optimizers_prints_a_line_for_each_optimizer_and_problem(capsys):
    main(["bench", "optimizers", "--problems", "1", "--starts", "1", "--budget", "4"])
    said = capsys.readouterr().out
    for name in ("Adam", "AutoAdam", "LBFGS", "LevenbergMarquardt", "CMAES", "Stages"):
        assert said.count(name) >= 4
    for problem in ("astronaut", "coffee", "pose", "inversion"):
        assert problem in said


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
