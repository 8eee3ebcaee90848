"""What is done with each input: one function per reader, which reads, looks and uses a little."""
