"""What every command does with a terminal: print, show progress, survive closed pipes."""
