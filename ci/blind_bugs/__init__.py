"""How many bugs of a C board the conformance suite catches: a folder of patches, one bug each."""
