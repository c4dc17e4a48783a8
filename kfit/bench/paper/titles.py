"""What tables call their rows, and what the paper prints of them."""

from __future__ import annotations

from kfit.bench.paper.variants import VARIANTS

# What the paper prints of REAL275: L1, AP10, AP60.
PUBLISHED = {
    ("1a", "without_3d"): ("0.109", "1.8", "90.2"),
    ("1a", "without_vae"): ("0.049", "12.3", "92.7"),
    ("1a", "full"): ("0.056", "16.5", "97.1"),
    ("1b", "code_4"): ("0.082", "9.1", "96.6"),
    ("1b", "full"): ("0.056", "16.5", "97.1"),
    ("1b", "code_128"): ("0.041", "11.4", "96.0"),
    ("2a", "full+l1"): ("", "14.3", "85.3"),
    ("2a", "full+l2"): ("", "13.2", "88.3"),
    ("2a", "full+ssim"): ("", "15.8", "92.5"),
    ("2a", "full+no_prior"): ("", "16.2", "95.9"),
    ("2a", "full"): ("", "16.5", "97.1"),
}
# The paper's own configuration is measured against the same numbers.
PUBLISHED |= {
    (f"paper_{table}", unit.replace("full", "paper", 1) if unit.startswith("full") else f"paper_{unit}"): numbers
    for (table, unit), numbers in PUBLISHED.items()
}
TITLES = {
    "paper+l1": "L1, prior",
    "paper+l2": "L2, prior",
    "paper+ssim": "SSIM, prior",
    "paper+no_prior": "VGG16 alone",
    "paper_depth+depth": "the paper's, RGB-D",
    "full+l1": "L1, prior",
    "full+l2": "L2, prior",
    "full+ssim": "SSIM, prior",
    "full+no_prior": "EfficientNet-Lite0 alone",
    "full+kfit": "kfit's own (EfficientNet-Lite0, SSIM, silhouette, prior)",
    "field+kfit": "kfit, RGB",
    "field+depth": "kfit, RGB-D",
}
IN_TABLE = {
    ("paper_2a", "paper"): "VGG16, prior",
    ("2a", "full"): "EfficientNet-Lite0, prior",
    ("curves", "full"): "one energy (EfficientNet-Lite0, prior), compact VAE3D",
}
HEADINGS = {
    "1a": "Table 1a: network architectures",
    "1b": "Table 1b: size of the code",
    "2a": "Table 2a: energies",
    "backbone": "Backbones at one training budget",
    "curves": "Methods compared",
    "robustness": "Robustness",
    "paper_1a": "Table 1a, the paper's configuration",
    "paper_1b": "Table 1b, the paper's configuration",
    "paper_2a": "Table 2a, the paper's configuration",
    "paper_curves": "Methods compared, the paper's configuration",
    "paper_robustness": "Robustness, the paper's configuration",
}


def title_of(unit: str, table: str = "") -> str:
    """What a table calls a unit."""
    if (table, unit) in IN_TABLE:
        return IN_TABLE[table, unit]
    if table == "backbone" and unit.endswith("+kfit"):
        return f"{VARIANTS[unit.partition('+')[0]].title}, kfit's own fit"
    return TITLES.get(unit) or VARIANTS[unit.partition("+")[0]].title
