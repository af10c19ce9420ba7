"""Published arrays and the paper's equations, with the figures that they give."""
