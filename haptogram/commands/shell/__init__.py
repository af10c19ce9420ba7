"""What all commands share: exit status, interrupts, output files, places, standard streams."""
