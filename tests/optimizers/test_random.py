import torch

from kfit.optimizers.random import normal


def test_a_row_s_numbers_depend_on_its_seed_alone():
    like = torch.zeros(1, dtype=torch.float64)
    whole = normal(torch.tensor([4, 5, 2**62]), (3, 2), like)
    assert whole.shape == (3, 3, 2)
    assert whole.dtype == torch.float64
    torch.testing.assert_close(normal(torch.tensor([5]), (3, 2), like), whole[1:2], rtol=0, atol=0)
    assert not torch.allclose(whole[0], whole[1])


def test_numbers_are_standard_normal_and_leave_torch_s_own_alone():
    before = torch.get_rng_state()
    drawn = normal(torch.arange(50), (400,), torch.zeros(1))
    assert torch.equal(torch.get_rng_state(), before)
    assert abs(float(drawn.mean())) < 0.03
    assert abs(float(drawn.std()) - 1) < 0.02
