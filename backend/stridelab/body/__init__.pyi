from .geometric_com import GeometricCom as GeometricCom
from .geometric_com import SegmentTrack as SegmentTrack
from .segment_model import SegmentModel as SegmentModel
from .segment_tables import Anthropometry as Anthropometry
from .segment_tables import SegmentRow as SegmentRow
from .segment_tables import SegmentTable as SegmentTable

__all__ = ["Anthropometry", "GeometricCom", "SegmentModel", "SegmentRow", "SegmentTable", "SegmentTrack"]
