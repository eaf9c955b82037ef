"""Identification: masses, centres, friction and torque constants from what a run has measured."""
