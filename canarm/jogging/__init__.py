"""Driving the cards by hand: the commands, what they do, and the driver that joins them to a bus.

`parsing` and `jog` have no input or output; `driver` owns bus and clock; the prompt is `canarm.commands.jog`'s.
"""
