"""Photos and masks from files, and masks from networks, GrabCut or detections."""

from kfit.segmentation.clean_mask import binary_mask, clean_mask
from kfit.segmentation.detections import Detections, Detector
from kfit.segmentation.frames import Frame, Frames, pictures
from kfit.segmentation.grabcut import GrabCut, mask_from_box
from kfit.segmentation.load_segmenter import load_segmenter
from kfit.segmentation.mask_rcnn import MaskRCNN
from kfit.segmentation.near_silhouette import mask_in_photo, mask_near
from kfit.segmentation.nocs_detections import nocs_detections
from kfit.segmentation.object_detector import ObjectDetector
from kfit.segmentation.object_mask import ObjectMask
from kfit.segmentation.onnx_network import OnnxNetwork
from kfit.segmentation.photo import Photo, depth_from_file, mask_from_alpha, mask_from_file, read_photo
from kfit.segmentation.protrusions import without_protrusions
from kfit.segmentation.salient_object import SalientObject
from kfit.segmentation.segmenter import Box, Segment, Segmenter
from kfit.segmentation.yolo_seg import YoloSeg

__all__ = [
    "Box",
    "Detections",
    "Detector",
    "Frame",
    "Frames",
    "GrabCut",
    "MaskRCNN",
    "ObjectDetector",
    "ObjectMask",
    "OnnxNetwork",
    "Photo",
    "SalientObject",
    "Segment",
    "Segmenter",
    "YoloSeg",
    "binary_mask",
    "clean_mask",
    "depth_from_file",
    "load_segmenter",
    "mask_from_alpha",
    "mask_from_box",
    "mask_from_file",
    "mask_in_photo",
    "mask_near",
    "nocs_detections",
    "pictures",
    "read_photo",
    "without_protrusions",
]
