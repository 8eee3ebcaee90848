"""The live relight preview: the photo with the fitted face under the lights as they are edited."""
