"""Network servers: access rules, bounds on new connections, and shutdown.

access             rules of which clients may connect: loopback, tokens, origins
connection_gate    connections before their first message is complete
http_server        an HTTP server behind both
end_signals        Ctrl-C and SIGTERM as a shutdown request
"""
