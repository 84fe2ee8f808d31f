"""The service: sentences over HTTP, streams over WebSocket, and the viewer's page."""
