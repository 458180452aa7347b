#pragma once  // included by the peer, not used by what is timed
