"""Turn a stored study into the numbers that a report shows; nothing here draws or reads the database."""
