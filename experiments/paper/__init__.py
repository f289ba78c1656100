"""The paper, figure by figure: what it printed, the same studies here, and a page of both."""
