"""What every room may use: files, the registry of names, and colours."""
