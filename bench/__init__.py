"""How fast each piece of work is on this machine, beside its peers and the machine's own memory bandwidth."""
