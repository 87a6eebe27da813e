"""Reports and pictures: the page that every HTML report extends, one style for all figures, plots of a run."""
