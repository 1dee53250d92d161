"""Describes sensors: parameters, presets, effects of pixels, and the inertial and motion-capture sensors.

``parameters`` has what may be known of a sensor, with the formulas from ``biases``; ``presets`` are sensor files;
``effects`` has one module per effect; ``imu`` and ``motion_capture`` simulate those sensors; ``rig`` puts several
cameras and IMUs on one body; ``clocks`` aligns the clocks of camera and motion capture.

A preset is a sensor file in the package, so that a value is written once, next to its unit and source. The dark
current is given once, as ``log_eps``: it is the floor of contrast and of the photoreceptor's bandwidth alike. The
IMU's filter acts on the continuous motion, so that nothing aliases and its delay is exact.
"""
