"""What each command accepts on the command line, without slow imports."""
