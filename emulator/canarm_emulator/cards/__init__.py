"""The Apple II's peripheral cards as registers, and what each of them offers as a CANopen I/O module.

One module per kind, of the name that the kind has in `canarm_protocol.cards`; its `plug_in` makes the card.
"""
