"""The whole way from images to a better reconstruction within a number of minutes."""
