"""How the embedded CLIPs are made, and their cards."""
