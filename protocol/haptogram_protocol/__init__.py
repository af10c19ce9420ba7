"""The Haptogram wire protocol: codec and sans-I/O connection, standard library only."""
