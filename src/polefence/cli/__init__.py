"""The commands of the command line, one module a group: options, and what is done with them."""
