"""The commands of the command line, one module each. They parse nothing by hand and know no physics."""
