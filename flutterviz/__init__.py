"""An interactive explorer of supersonic panel flutter and its suppression by piezoceramic patches."""
