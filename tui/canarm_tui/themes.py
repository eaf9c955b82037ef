"""A theme of the dashboard's own: colours that people tell apart whatever they see of red and green.

Meaning never hangs on a colour alone, in this theme or another.
"""

from textual.theme import Theme

SAFE = Theme(
    name="okabe-ito",
    primary="#56B4E9",
    secondary="#0072B2",
    accent="#CC79A7",
    success="#009E73",
    warning="#E69F00",
    error="#D55E00",
    foreground="#E8E8E8",
    background="#101418",
    surface="#181D22",
    panel="#222A31",
    dark=True,
)
"""The palette of M. Okabe and K. Ito, Color Universal Design (2008)."""
