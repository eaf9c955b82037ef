"""The Apple II's peripheral cards, as registers and as CANopen I/O modules.

There is one module per kind, named as in `canarm_protocol.cards`; its `plug_in` makes the card.
"""
