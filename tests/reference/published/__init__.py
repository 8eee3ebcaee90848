"""Face model files of the published structures, on heads made for tests."""
