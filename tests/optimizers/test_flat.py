import torch

from kfit.optimizers.flat import flatten, unflatten


def test_numbers_of_a_row_lie_side_by_side_and_come_back():
    variables = {"a": torch.rand(3), "b": torch.rand(3, 2, 2), "c": torch.rand(3, 1)}
    flat = flatten(variables)
    assert flat.shape == (3, 6)
    assert flat[1].tolist() == [variables["a"][1], *variables["b"][1].flatten(), variables["c"][1, 0]]
    for name, value in unflatten(flat, variables).items():
        torch.testing.assert_close(value, variables[name], rtol=0, atol=0)


def test_any_number_of_rows_comes_back_in_the_shapes_of_a_row():
    like = {"a": torch.rand(3), "b": torch.rand(3, 2)}
    assert {name: value.shape for name, value in unflatten(torch.rand(7, 3), like).items()} == {"a": (7,), "b": (7, 2)}
