"""Errors of jsonargparse in one sentence: the argument, what was expected, and what may be meant."""

import pytest

import kfit.generators  # noqa: F401
from kfit.runtime.parse_errors import sentence

MODEL = """Parser key "model":
  Does not validate against any of the Union subtypes
  Subtypes: [<class 'lightning.pytorch.core.module.LightningModule'>, <class 'NoneType'>]
  Errors:
    - Problem with given class_path 'kfit.training.ConditionalVAE':
        Parser key "generator":

          - Expected a path but {0} either not accessible or invalid
          - {1}
    - Expected a <class 'NoneType'>
  Given value type: <class 'jsonargparse._util.NestedArg'>
  Given value: NestedArg(key='generator', val='{0}')"""
CALLBACKS = """Parser key "trainer.callbacks":

  - Expected a path but EarlyStoping either not accessible or invalid
  - Does not validate against any of the Union subtypes
  Subtypes: [list[lightning.pytorch.callbacks.callback.Callback], <class 'NoneType'>]
  Errors:
    - Expected a dot import path string: EarlyStoping
    - Expected a <class 'NoneType'>
  Given value type: <class 'str'>
  Given value: EarlyStoping"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            MODEL.format("VAE3d", "Expected a dot import path string: VAE3d"),
            "model.generator: there is no class VAE3d; did you mean kfit.generators.VAE3D?",
        ),
        (
            MODEL.format(
                "kfit.generators.VAE3",
                "Problem with given class_path 'kfit.generators.VAE3':\n"
                "            module 'kfit.generators' has no attribute 'VAE3'",
            ),
            "model.generator: module 'kfit.generators' has no attribute 'VAE3'; did you mean kfit.generators.VAE3D?",
        ),
        (
            MODEL.format(
                "",
                "Problem with given class_path 'kfit.generators.VAE3D':\n          Option 'code_dims' is not accepted",
            ),
            "model.generator: Option 'code_dims' is not accepted; did you mean code_dim?",
        ),
    ],
)
def test_a_misspelt_class_is_named_with_its_argument_and_the_one_meant(text, message):
    assert sentence(text) == message


def test_a_misspelt_callback_of_lightning_s_is_named_too():
    import lightning.pytorch.callbacks  # noqa: F401

    assert sentence(CALLBACKS) == (
        "trainer.callbacks: there is no class EarlyStoping; did you mean lightning.pytorch.callbacks.EarlyStopping?"
    )
