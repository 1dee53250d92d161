"""Defines what everything meets at: arrays of events, packets of them, and the luma that they are made of.

``arrays`` has the dtype and its checks, ``dtypes`` those of other packages, ``packet`` what a simulation hands on,
``decoded`` what a camera sends in addition to events, ``luma`` the frames that are rendered, ``represent`` images
and tensors of events, ``matching`` one stream compared with another, ``filters`` which
events of a stream are left out.

Luma is 0.299 R + 0.587 G + 0.114 B on linear RGB, as in the original simulator; Mitsuba's own luminance has other
weights.
"""

from . import filters as filters  # so that these are davis_rs.filters and davis_rs.represent, too
from . import represent as represent
