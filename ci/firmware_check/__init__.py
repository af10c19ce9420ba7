"""The firmware of ``protocol/c/ports`` in QEMU: built, started, judged by conform and verify."""
