"""What is known of every face, whatever its mesh: landmark schemes, regions, colors of its tissues.

May import the contract, numpy and the room mesh.
"""
