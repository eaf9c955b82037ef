"""A CAN bus as it is seen: what was received, who is there, what it means. Only `sdo_desk` ever sends."""
