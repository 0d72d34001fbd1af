"""An arm that renders a fixture before there is one: reach, torques, reflexes, in simulation.

A leaf room: no other package imports it. Its command is `vfplan rehearse`. It needs the extra
`[arm]` (MuJoCo), and no screen and no network.
"""
