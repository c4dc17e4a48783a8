"""Names of detectors' classes, and which of kfit's categories each is."""

from __future__ import annotations

# COCO's 80 classes in their order; its own numbers run from 1 to 90, as ten were dropped from the 90 first planned.
COCO = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat", "traffic light",
    "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog", "horse", "sheep", "cow", "elephant",
    "bear", "zebra", "giraffe", "backpack", "umbrella", "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard",
    "sports ball", "kite", "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange", "broccoli",
    "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch", "potted plant", "bed", "dining table", "toilet",
    "tv", "laptop", "mouse", "remote", "keyboard", "cell phone", "microwave", "oven", "toaster", "sink",
    "refrigerator", "book", "clock", "vase", "scissors", "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip
DROPPED = (12, 26, 29, 30, 45, 66, 68, 69, 71, 83)
COCO_BY_OWN_NUMBER = dict(zip((n for n in range(1, 91) if n not in DROPPED), COCO, strict=True))

# As COCO, LVIS, Open Images, Objects365 and NOCS name them.
SYNONYMS = {
    "bottle": {"beer bottle", "water bottle", "wine bottle"},
    "bowl": {"soup bowl"},
    "camera": {"digital camera"},
    "can": {"tin can", "beer can", "canned"},
    "laptop": {"laptop computer", "notebook computer"},
    "mug": {"cup", "coffee cup", "coffee mug"},
}


def category_of(name: str) -> str | None:
    """Return kfit's category of a detector's class, or None: "cup" is a mug.

    Case does not matter, an underscore is a space, and of names joined by a slash each counts ("can/tin can").
    """
    for word in name.lower().replace("_", " ").split("/"):
        for category, others in SYNONYMS.items():
            if word.strip() == category or word.strip() in others:
                return category
    return None
