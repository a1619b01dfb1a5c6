"""Dimensions of the ego car, an electric saloon: the one place that owns them.

Physics, sensors, assets, town and traffic all read them here. Frame `base_link`: FLU, on the ground
below the middle of the rear axle.
"""

EGO_SIZE_M = (4.70, 1.85, 1.45)
"""Length, width, height of the ego's body [m]."""
EGO_REAR_M = -0.95
"""Where the ego's body begins along x of `base_link` [m]."""
EGO_FRONT_M = EGO_REAR_M + EGO_SIZE_M[0]
"""Where the ego's front bumper ends along x of `base_link` [m]."""
EGO_WHEELBASE_M = 2.875
"""Distance between the ego's axles [m]."""
EGO_TRACK_M = 1.58
"""Distance between the middles of the ego's left and right tyres [m]."""
EGO_TYRE_OUTER_M = 0.89
"""Distance from the ego's middle to the outer side of its tyres [m]: half the track, half a tyre."""
EGO_TYRE_ENVELOPE_M = 0.17
"""How far before and behind its hub a tyre touches a step of the road first [m]."""
EGO_TYRE_RADIUS_M = 0.334
"""Radius of the ego's unloaded tyres [m]; under their static load they stand 0.02 m lower."""
EGO_ROLLING_RADIUS_M = 0.311
"""Rolling radius of the ego's wheels under load [m]: distance covered per radian of a wheel's turning."""
EGO_STEERING_RATIO = 12.0
"""Steering-wheel angle per road-wheel angle of the ego."""
