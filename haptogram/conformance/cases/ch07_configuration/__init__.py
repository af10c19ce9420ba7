"""Chapter 7, configuration, geometry, uploads and playback."""
