"""Identification of the segmenter in an ONNX file."""

from __future__ import annotations

from pathlib import Path

from kfit.segmentation.mask_rcnn import MaskRCNN
from kfit.segmentation.onnx_network import OnnxNetwork
from kfit.segmentation.salient_object import SalientObject
from kfit.segmentation.segmenter import Segmenter
from kfit.segmentation.yolo_seg import YoloSeg


def load_segmenter(path: str | Path) -> Segmenter:
    """Load an ONNX model that finds objects: Mask R-CNN, YOLO-seg, U²-Net or IS-Net, distinguished by their layouts.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not an ONNX model, or has another layout, which the message describes.
    """
    network = OnnxNetwork(path)
    for kind in (YoloSeg, MaskRCNN, SalientObject):
        if kind.fits(network):
            return kind(network)
    raise ValueError(f"{path} has the layout of neither Mask R-CNN, YOLO-seg, U²-Net nor IS-Net ({network.layout})")
