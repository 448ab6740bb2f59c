"""Where work is done: by processes of this machine, forks of this one, machines of a cluster."""
