"""Names of numpy's array types, and the acceleration of free fall.

Shapes and units stand where arrays are used.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers to compute with."""
F32 = NDArray[np.float32]
"""What sensors measure and GPUs read."""
I32 = NDArray[np.int32]
"""Whole numbers with sign, 32 bits."""
U8 = NDArray[np.uint8]
"""Bytes: colours, tags, materials."""
U32 = NDArray[np.uint32]
"""Whole numbers, 32 bits: instances, times in a scan [ns]."""
Index = NDArray[np.intp]
"""Rows of other arrays."""
Mask = NDArray[np.bool_]
"""Which rows or pixels are meant."""
GRAVITY_MPS2 = 9.81
"""Acceleration of free fall, along −z of the world [m/s²]; in physics, IMU and written calibration alike."""
