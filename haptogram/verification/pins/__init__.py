"""The verdict by the drive pins: which frame each pin shows, when it latched, and how well."""
