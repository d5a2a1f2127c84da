"""What is believed of traffic: one tracker of reports of any source.

- :mod:`envs.tracking.estimate`: a Kalman filter of an aircraft that turns at a known rate.
- :mod:`envs.tracking.agreement`: whether positions and velocities of reports can both be true.
- :mod:`envs.tracking.heights`: the same of altitudes and vertical speeds.
- :mod:`envs.tracking.tracker`: the interacting-multiple-model filter that puts them together.
- :mod:`envs.tracking.single`: the same for one aircraft, compiled.
"""
