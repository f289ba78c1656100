"""The only room that reads ground truth."""
