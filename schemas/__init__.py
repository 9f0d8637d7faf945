"""What things are: the signal vocabulary, the Arrow schema of every stored table, the project and its files."""
