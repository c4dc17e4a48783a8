import torch

from kfit.energies import CodePrior


def test_it_is_the_mean_square_of_the_code():
    torch.testing.assert_close(CodePrior()(torch.tensor([[1.0, -2.0], [0.0, 0.0]])), torch.tensor([2.5, 0.0]))


def test_it_can_stand_on_any_variable_of_any_shape():
    assert CodePrior().on == "code"
    prior = CodePrior(on="style")
    assert prior.on == "style"
    torch.testing.assert_close(prior(torch.tensor([2.0, 3.0])), torch.tensor([4.0, 9.0]))
    torch.testing.assert_close(prior(torch.ones(2, 3, 4, 4)), torch.ones(2))
