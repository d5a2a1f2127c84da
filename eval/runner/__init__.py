"""What every command of the evaluation shares: chunks on workers, outputs, progress, resume."""
