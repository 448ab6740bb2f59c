"""Where work is done: by processes of this machine, machines of a cluster."""
