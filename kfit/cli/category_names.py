"""What people call the categories, for ``--category``."""

from __future__ import annotations

from kfit.runtime.did_you_mean import near

NAMES = {
    "bottle": ("flask", "water bottle", "wine bottle"),
    "bowl": ("dish", "salad bowl"),
    "camera": ("digital camera",),
    "can": ("drink can", "soda can", "tin"),
    "laptop": ("notebook",),
    "mug": ("coffee cup", "cup", "teacup"),
}
SPOKEN = ", ".join(f"{category} (or {', '.join(others)})" for category, others in NAMES.items())


def named_category(name: str) -> str:
    """The category that a person names; case, hyphens and a plural's s do not matter.

    Raises:
        ValueError: for a word that names none; it lists those that are known.

    >>> named_category("Cups")
    'mug'
    """
    word = " ".join(name.lower().replace("-", " ").replace("_", " ").split())
    for category, others in NAMES.items():
        if {word, word.removesuffix("s")} & {category, *others}:
            return category
    meant = near(word, {*NAMES, *(other for others in NAMES.values() for other in others)})
    raise ValueError(f"category {name!r} is not known; those known are {SPOKEN}{meant and ';'}{meant}")
